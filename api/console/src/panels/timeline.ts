/** The written show as a band: its cues, where it is in them, and a press to begin elsewhere. */

import { html, nothing, type TemplateResult } from "lit-html";
import { fresh, type State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { minutes } from "./format";
import { icon } from "./icons";
import { place } from "./place";
import { whyNot, whyNotOnGround } from "./rights";
import { halted } from "../features";

export interface Segment {
  cue: string;
  at_s: number;
  until_s: number;
}

/** Each cue until the next. Pure. */
export function segments(timeline: readonly { cue: string; at_s: number }[], duration_s: number): Segment[] {
  return timeline.map((each, i) => ({ ...each, until_s: Math.max(each.at_s, timeline[i + 1]?.at_s ?? duration_s) }));
}

/** Which passage is played at `clock_s`; -1 before the first. */
export function playing(all: readonly Segment[], clock_s: number): number {
  return all.findLastIndex((each) => each.at_s <= clock_s);
}

export function timeline(state: State, actions: PanelActions): TemplateResult {
  const show = state.status?.show.selected;
  if (!show || !state.status) {
    return html`<section class="timeline none" aria-label=${texts.timeline.title}>
      <p>${state.status ? texts.timeline.none : texts.shape.none}</p>
    </section>`;
  }
  const clock_s = state.frame && Number.isFinite(state.frame.clock_s) ? state.frame.clock_s : show.clock_s;
  const runs = show.runs && halted(state.status) === "";
  const all = segments(state.status.timeline, show.duration_s);
  const now = playing(all, clock_s);
  const why = whyNot(state, "seek") || whyNotOnGround(state);
  const share = (time_s: number): string => `${(100 * Math.min(1, Math.max(0, time_s / show.duration_s))).toFixed(3)}%`;
  return html`<section class="timeline" aria-label=${texts.timeline.title} data-testid="timeline">
    <header>
      <strong data-testid="timeline-show">${show.name}</strong>
      <span data-testid="timeline-cue">${show.cue}</span>
      <span class="tag">${icon(runs && fresh(state) ? "start" : "pause")}${runs ? texts.timeline.runs : texts.timeline.stands}</span>
      ${show.target_is_live ? html`<span class="tag accent">${texts.timeline.live}</span>` : nothing}
      <span class="spring"></span>
      <span class="clock value" data-testid="show-clock">${minutes(clock_s)} / ${minutes(show.duration_s)}</span>
    </header>
    <div class="band">
      ${all.map(
        (each, i) => html`<button
          type="button"
          class="cue ${i === now ? "now" : i < now ? "past" : ""}"
          data-testid="cue-${i}"
          aria-current=${i === now ? "step" : nothing}
          aria-disabled=${why === "" ? nothing : "true"}
          aria-label=${why === "" ? texts.timeline.seek(each.cue, minutes(each.at_s)) : texts.timeline.at(each.cue, minutes(each.at_s))}
          title="${texts.timeline.at(each.cue, minutes(each.at_s))}${why ? ` (${texts.shows.seek}: ${why})` : ""}"
          ${place({ left: share(each.at_s), width: share(each.until_s - each.at_s) })}
          @click=${() => (why === "" ? actions.seek(each.cue) : actions.refuse(texts.commands.seek(each.cue), why))}
        >
          <span>${each.cue}</span>
        </button>`,
      )}
      <div class="playhead" data-testid="playhead" ${place({ left: share(clock_s) })}></div>
    </div>
  </section>`;
}
