/** The timecode that shows follow: where it is, how the show stands to it, and that the show is frozen without it. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { State, Status, Timecode } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { twice } from "./controls";
import { clockTime, fixed, minutes, seconds, UNKNOWN } from "./format";
import { icon, type IconName } from "./icons";
import { whyNot } from "./rights";

const t = texts.timecode;

const STATE_ICON: Record<Timecode["state"], IconName> = {
  none: "question",
  running: "start",
  "dropped-out": "caution",
  stopped: "pause",
  lost: "warning",
  refused: "cross",
};

/** Whether the running show stands still because its timecode does. Pure. */
export function isFrozen(status: Status | null): boolean {
  return status?.timecode?.frozen_since_unix_time_s != null;
}

/** By how much the show is off, in words; "" where it does not follow. Pure. */
export function apart(behind_s: number): string {
  if (!Number.isFinite(behind_s)) return "";
  const size_s = Math.abs(behind_s);
  const size = size_s < 1 ? `${fixed(1000 * size_s, 0)} ms` : seconds(size_s);
  return behind_s >= 0 ? t.behind(size) : t.ahead(size);
}

const TEMPO_OFF_MIN = 0.005;

/** How fast the show runs where that is not as drawn; "" else. Pure. */
export function catchesUp(tempo: number): string {
  return Math.abs(tempo - 1) >= TEMPO_OFF_MIN ? t.tempo(fixed(tempo, 2)) : "";
}

/** Whole seconds, and minutes from one on. */
const lasting = (time_s: number): string => (time_s < 60 ? `${Math.floor(time_s)} s` : minutes(time_s));

function stance(state: State, found: Timecode): TemplateResult {
  const { frame } = state;
  const since_s = found.frozen_since_unix_time_s;
  const off = html`<span class="value" data-testid="timecode-behind">${apart(frame?.behind_s ?? NaN)}</span>`;
  if (!found.followed) return html`<span data-testid="timecode-stance">${t.notFollowed}</span>`;
  if (since_s !== null) {
    const lasts_s = Math.max(0, (frame?.unix_time_s ?? NaN) - since_s);
    return html`<strong data-testid="timecode-stance">${t.frozen}</strong>
      <span class="value big-figure" data-testid="frozen-for">${lasting(lasts_s)}</span>
      <span data-testid="frozen-why" title=${found.problem}>${t.why[found.state]} ${t.since(clockTime(since_s))}</span>${off}`;
  }
  const text = found.problem !== "" && state.status?.show.selected ? t.waits(found.problem) : "";
  return html`<span data-testid="timecode-stance">${text}</span>${off} ${catchesUp(frame?.tempo ?? NaN)}`;
}

/** Across the page wherever timecode is configured; red while the show is frozen without it. */
export function timecodeStrip(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const found = state.status?.timecode;
  if (!found || state.status?.replay) return nothing;
  const frozen = isFrozen(state.status);
  const isMissing = frozen && (found.state === "lost" || found.state === "none");
  const look = isMissing ? "missing" : frozen ? "frozen" : "";
  const isOffered = frozen || !found.followed;
  return html`<section class="strip timecode-strip ${look}" aria-label=${t.title} data-testid="timecode" data-state=${found.state}>
    <div class="strip-words">
      <span class="strip-group" title=${t.rateHint(found.frame_rate)}>
        ${icon(STATE_ICON[found.state])}<span class="dim">${t.short}</span>
        <span class="value big-figure" data-testid="timecode-label">${state.frame?.timecode || UNKNOWN}</span>
        <span data-testid="timecode-state">${t.states[found.state]}</span>
      </span>
      <span class="strip-source dim" data-testid="timecode-source">${found.source}</span>
      <span class="strip-group stance" role=${frozen ? "alert" : nothing}>${stance(state, found)}</span>
    </div>
    ${isOffered
      ? twice(state, actions, {
          id: "follow",
          label: found.followed ? t.byClock : t.follow,
          sure: found.followed ? t.sureByClock : t.sureFollow,
          about: `follow:${!found.followed}`,
          why: whyNot(state, "timecode"),
          press: () => actions.followTimecode(!found.followed),
        })
      : nothing}
  </section>`;
}
