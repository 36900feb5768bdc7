/** The timecode that shows follow: where it is, how the show stands to it, and that the show is frozen without it. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PanelActions } from "../panels/actions";
import { twice } from "../panels/controls";
import { clockTime, fixed, minutes, seconds, UNKNOWN } from "../panels/format";
import { icon, type IconName } from "../panels/icons";
import type { Features, State } from "../state";
import type { Feature } from "./feature";

type Timecode = NonNullable<Features["timecode"]>;

export const t = {
  title: "Timecode",
  begins: "With the timecode",
  short: "TC",
  rateHint: (rate: string): string => (rate === "" ? "Frames a second: not known yet" : `${rate} frames a second`),
  states: { none: "none yet", running: "running", "dropped-out": "drop-out", stopped: "stopped", lost: "LOST", refused: "jumped: not followed" },
  why: {
    none: "no timecode", running: "timecode runs", "dropped-out": "timecode runs", stopped: "timecode stopped", lost: "timecode lost", refused: "timecode jumped too far",
  },
  since: (time: string): string => `since ${time}`,
  phase: "frozen",
  frozen: "SHOW FROZEN",
  behind: (size: string): string => `show ${size} behind`,
  ahead: (size: string): string => `show ${size} ahead`,
  tempo: (rate: string): string => `at ${rate} of its speed`,
  waits: (why: string): string => `The show waits: ${why}`,
  notFollowed: "Not followed: the show runs by the station's clock",
  byClock: "Run by clock",
  sureByClock: "Yes, go on by the clock now",
  follow: "Follow timecode",
  sureFollow: "Yes, follow the timecode now",
  follows: "The show follows the timecode",
  letGo: "The show runs by the station's clock",
};

const STATE_ICON: Record<Timecode["state"], IconName> = {
  none: "question",
  running: "start",
  "dropped-out": "caution",
  stopped: "pause",
  lost: "warning",
  refused: "cross",
};

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

function follow(actions: PanelActions, follow: boolean): void {
  void actions.ask(t.title, (api) => api.POST("/api/v1/show/external-clock", { body: { follow } }), follow ? t.follows : t.letGo);
}

/** Across the page wherever timecode is configured; red while the show is frozen without it. */
function strip(state: State, actions: PanelActions, why: string): TemplateResult | null {
  const found = state.status?.features.timecode;
  if (!found || state.status?.replay) return null;
  const frozen = found.frozen_since_unix_time_s !== null;
  const isMissing = frozen && (found.state === "lost" || found.state === "none");
  const look = isMissing ? "missing" : frozen ? "frozen" : "";
  const isOffered = frozen || !found.followed;
  return html`<section class="strip timecode-strip ${look}" aria-label=${t.title} data-testid="timecode" data-state=${found.state}>
    <div class="strip-words">
      <span class="strip-group" title=${t.rateHint(found.frame_rate)}>
        ${icon(STATE_ICON[found.state])}<span class="dim">${t.short}</span>
        <span class="value big-figure mono" data-testid="timecode-label">${state.frame?.label || UNKNOWN}</span>
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
          why,
          press: () => follow(actions, !found.followed),
        })
      : nothing}
  </section>`;
}

export const timecode: Feature = {
  strip,
  halts: ({ features }) => (features.timecode?.frozen_since_unix_time_s == null ? "" : t.phase),
  begins: ({ features }) => (features.timecode?.followed ? t.begins : ""),
};
