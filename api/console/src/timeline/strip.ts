/** The timeline of what this service flies: the plan of a show, the flight that lasts, or the last one. */

import { html, nothing, type TemplateResult } from "lit-html";
import { alarmsOf } from "../alarms/model";
import { halted } from "../features";
import type { PanelActions } from "../panels/actions";
import { button } from "../panels/controls";
import { clockTime, minutes } from "../panels/format";
import { icon } from "../panels/icons";
import { isSmall } from "../panels/layout";
import { place } from "../panels/place";
import { whyNot, whyNotOnGround } from "../panels/rights";
import { fresh, type Frame, type SelectedShow, type State } from "../state";
import { texts } from "../texts";
import { courseView, marked, markText, nameOf, partAt } from "./course";
import { flightCourse, GROUND, isPlan, percent, type Course, type Mark, type Part } from "./model";

const t = texts.timeline;

/** A press on a mark: the alarm in its list where it is still there, else what the log or the commands say. */
export function openMark(actions: PanelActions, { alarm, kind }: Mark): void {
  const { status, panels } = actions.now();
  if (alarm === null || !alarmsOf(status).some((each) => each.id === alarm)) {
    actions.openPanel("events");
    actions.set({ eventList: kind === "command" ? "commands" : "lines" });
    return;
  }
  actions.dispatch({ kind: "fold-alarms", isFolded: false });
  if (isSmall(panels.layout)) actions.set({ allAlarms: true });
  requestAnimationFrame(() => requestAnimationFrame(() => document.querySelector<HTMLElement>(`[data-alarm="${CSS.escape(alarm)}"]`)?.focus()));
}

/** A cue of the plan begins the show there. */
function cueButton(state: State, actions: PanelActions, part: Part, title: string): TemplateResult | null {
  const { cue } = part;
  if (cue === null) return null;
  const why = whyNot(state, "seek") || whyNotOnGround(state);
  const at = minutes(state.status?.timeline.find((each) => each.cue === cue)?.at_s);
  return html`<button
    type="button"
    data-testid="cue-${cue}"
    aria-disabled=${why === "" ? nothing : "true"}
    aria-label=${why === "" ? t.seek(cue, at) : t.at(cue, at)}
    title="${title}${why ? ` (${texts.shows.seek}: ${why})` : ""}"
    @click=${() => (why === "" ? actions.seek(cue) : actions.refuse(texts.commands.seek(cue), why))}
  >
    ${cue}
  </button>`;
}

/** Where the show or the flight is. */
function clock({ status, frame, marks }: State, course: Course, isLast: boolean): string {
  const show = status!.show.selected;
  if (isLast) return t.lasted(minutes(course.duration_s), clockTime(marks!.began_unix_time_s! + course.duration_s));
  return show ? `${minutes(show_s(frame, show))} / ${minutes(show.duration_s)}` : t.elapsed(minutes(course.now_s));
}

/** What is left of it, in words, as far as that is known. */
function left({ status, frame }: State): string {
  const { phase, selected: show } = status!.show;
  const [home_s, assembled_s] = [frame?.home_s ?? NaN, frame?.assembled_s ?? NaN];
  const rest_s = show && (phase === "running" || phase === "paused") ? Math.max(0, show.duration_s - show_s(frame, show)) : NaN;
  const down_s = phase === "returning" ? home_s : rest_s + home_s;
  const parts: readonly (readonly [number, (time: string) => string])[] = [[phase === "assembling" ? assembled_s : NaN, t.begins], [rest_s, t.left], [down_s, t.down]];
  return parts.filter(([time_s]) => Number.isFinite(time_s)).map(([time_s, words]) => words(minutes(Math.ceil(time_s)))).join(", ");
}

const show_s = (frame: Frame | null, show: SelectedShow): number => (frame && Number.isFinite(frame.clock_s) ? frame.clock_s : show.clock_s);

/** Nothing where nothing is selected and nothing has flown. On a phone one line, which opens. */
export function timeline(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const course = flightCourse(state);
  if (course === null || state.status === null) return nothing;
  const { status, panels } = state;
  const show = status.show.selected;
  const isPlanned = isPlan(state);
  const isLast = !isPlanned && GROUND.includes(status.show.phase);
  const runs = show?.runs && halted(status) === "";
  const isOpen = panels.timeline || !isSmall(panels.layout);
  const name = isLast ? t.last : (show?.name ?? t.flight);
  const now = partAt(course, course.now_s);
  return html`<section class="timeline ${isOpen ? "open" : ""}" aria-label=${t.title} data-testid="timeline">
    <header>
      <strong data-testid="timeline-show" title=${name}>${name}</strong>
      ${isLast ? nothing : html`<span class="timeline-cue" data-testid="timeline-cue" title=${show?.cue ?? nothing}>${isPlanned ? show!.cue : now && nameOf(now)}</span>`}
      ${show && !isLast ? html`<span class="tag">${icon(runs && fresh(state) ? "start" : "pause")}${runs ? t.runs : t.stands}</span>` : nothing}
      ${show?.target_is_live ? html`<span class="tag accent">${t.live}</span>` : nothing}
      <span class="spring"></span>
      <span class="dim value" data-testid="timeline-left">${left(state)}</span>
      <span class="clock value" data-testid="show-clock">${clock(state, course, isLast)}</span>
      ${show && status.show.phase === "landed"
        ? button(actions, { id: "timeline-plan", label: isPlanned ? t.last : t.plan, kind: "quiet", press: () => actions.set({ plan: !isPlanned }) })
        : nothing}
      ${isSmall(panels.layout)
        ? button(actions, {
            id: "timeline-open", label: isOpen ? t.fold : t.open, icon: isOpen ? "down" : "up", iconOnly: true, kind: "quiet", expanded: isOpen,
            press: () => actions.set({ timeline: !isOpen }),
          })
        : nothing}
    </header>
    ${isOpen
      ? courseView(course, {
          marks: marked(state, actions, (mark) => openMark(actions, mark), markText),
          button: isPlanned ? (part, title) => cueButton(state, actions, part, title) : undefined,
        })
      : html`<div class="timeline-line"><span ${place({ width: percent(course.now_s / course.duration_s) })}></span></div>`}
  </section>`;
}
