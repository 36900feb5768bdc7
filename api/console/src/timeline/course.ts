/** A timeline as it is drawn: parts to scale, a play head, marks; where it can be sought, also a slider. */

import { html, nothing, type TemplateResult } from "lit-html";
import { guard } from "lit-html/directives/guard.js";
import type { PanelActions } from "../panels/actions";
import { minutes } from "../panels/format";
import { place, sized } from "../panels/place";
import type { State } from "../state";
import { texts } from "../texts";
import { marksOf, percent, type Course, type Mark, type Part } from "./model";

const t = texts.timeline;
const KEY_S: Readonly<Record<string, number>> = { ArrowLeft: -5, ArrowDown: -5, ArrowRight: 5, ArrowUp: 5, PageDown: -30, PageUp: 30 };
const THUMB_PX = 16; // its middle runs from half of it to half of it before the end

export interface Slider {
  id: string; // data-testid
  label: string;
  where: string; // the position in words
  /** While it is dragged, and once it is let go. */
  moved(at_s: number, isDone: boolean): void;
}

export interface Marks {
  width_px: number; // of the course; 0: not known yet
  resized(width_px: number): void;
  press(mark: Mark): void;
  /** The name of a mark's press. */
  named(mark: Mark): string;
}

/** The width is the page's: there is one course at a time. */
export function marked({ panels: { course_px } }: State, actions: PanelActions, press: Marks["press"], named: Marks["named"]): Marks {
  return { width_px: course_px, resized: (px) => actions.set({ course_px: px }), press, named };
}

export interface Use {
  slider?: Slider;
  marks?: Marks;
  /** A part that can be pressed is a button; null: it cannot. */
  button?: ((part: Part, title: string) => TemplateResult | null) | undefined;
}

export const nameOf = ({ cue, phase }: Pick<Part, "cue" | "phase">): string => cue ?? texts.phases[phase];

export const partAt = ({ parts }: Course, at_s: number): Part | undefined => parts.findLast((each) => each.from_s <= at_s);

export function titleOf(part: Part): string {
  return part.isGuess ? t.guess(nameOf(part), minutes(part.from_s)) : t.span(nameOf(part), minutes(part.from_s), minutes(part.until_s));
}

export const markText = ({ at_s, kind, text }: Mark): string => t.mark(minutes(at_s), t.kinds[kind], text);

function slider(course: Course, { id, label, where, moved }: Slider): TemplateResult {
  const { duration_s, now_s } = course;
  const input = (event: Event): HTMLInputElement => event.target as HTMLInputElement;
  return html`<input
    type="range"
    min="0"
    max=${duration_s}
    step="0.1"
    data-testid=${id}
    aria-label=${label}
    aria-valuetext=${where}
    .value=${String(now_s)}
    @input=${(event: Event) => moved(Number(input(event).value), false)}
    @change=${(event: Event) => moved(Number(input(event).value), true)}
    @keydown=${(event: KeyboardEvent) => {
      const by_s = KEY_S[event.key];
      if (by_s === undefined) return;
      event.preventDefault();
      input(event).value = String(Math.min(duration_s, Math.max(0, Number(input(event).value) + by_s)));
      moved(Number(input(event).value), true);
    }}
    @pointermove=${(event: PointerEvent) => {
      const { left, width } = input(event).getBoundingClientRect();
      const part = partAt(course, (duration_s * (event.clientX - left - THUMB_PX / 2)) / (width - THUMB_PX));
      input(event).title = part === undefined ? "" : titleOf(part);
    }}
  />`;
}

function marksView({ marks, duration_s }: Course, { width_px, resized, press, named }: Marks): TemplateResult {
  const one = (mark: Mark): TemplateResult => html`<li
    class="mark mark-${mark.kind} ${mark.isCommanded ? "commanded" : ""} ${mark.at_s > duration_s / 2 ? "late" : ""}"
    ${place({ left: percent(mark.at_s / duration_s) })}
  >
    <button type="button" data-testid="mark-${mark.kind}" aria-label=${named(mark)} @click=${() => press(mark)}></button>
    <span class="mark-says" aria-hidden="true">${markText(mark)}</span>
  </li>`;
  return html`<ul class="marks" aria-label=${t.marks} data-testid="marks" ${sized((list) => resized(Math.floor(list.getBoundingClientRect().width)))}>
    ${guard([marks, duration_s, width_px], () => (marks === null || width_px === 0 ? nothing : marksOf(marks, duration_s, width_px).map(one)))}
  </ul>`;
}

export function courseView(course: Course, use: Use): TemplateResult {
  const { now_s, duration_s, parts, idle, lit } = course;
  const share = (time_s: number): string => percent(time_s / duration_s);
  const spread = (from_s: number, until_s: number) => place({ left: share(from_s), width: percent((until_s - from_s) / duration_s) });
  const now = partAt(course, now_s);
  return html`<div class="course ${use.marks ? "marked" : ""}" data-testid="course">
    <ol class="parts" aria-label=${t.parts}>
      ${parts.map((part) => {
        const title = titleOf(part);
        const when = part === now ? "now" : part.until_s <= now_s && !use.button ? "past" : "ahead";
        return html`<li class="part phase-${part.phase} ${when} ${part.isGuess ? "guess" : ""}" title=${title} aria-current=${part === now ? "step" : nothing} ${spread(part.from_s, part.until_s)}>
          ${use.button?.(part, title) ?? html`<span>${nameOf(part)}</span>`}
        </li>`;
      })}
    </ol>
    ${idle.map((each) => html`<span class="idle" title=${texts.replay.idle} ${spread(each.from_s, each.until_s)}></span>`)}
    ${lit ? html`<span class="lit" title=${t.lit(minutes(lit.from_s), minutes(lit.until_s))} ${spread(lit.from_s, lit.until_s)}></span>` : nothing}
    <span class="playhead" data-testid="playhead" ${place({ left: share(now_s) })}></span>
    ${use.slider ? slider(course, use.slider) : nothing}
    ${use.marks ? marksView(course, use.marks) : nothing}
  </div>`;
}
