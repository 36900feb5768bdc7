/** Energy and time at a glance: least and median battery, the first to be low, assembled in, home in. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { Frame, State } from "../state";
import { texts } from "../texts";
import { minutes, percent } from "./format";

const t = texts.energy;

export interface Entry {
  id: "least" | "median" | "low" | "assembled" | "home";
  name: string;
  value: string;
  hint: string;
}

/** The known values in reading order; unknown values are left out, never guessed. Pure. */
export function entries(frame: Frame, ids: readonly string[]): Entry[] {
  const least = ids[frame.batteryLeastRow];
  const first = firstLow(frame);
  const all: (Entry | null)[] = [
    Number.isFinite(frame.batteryLeast) && least !== undefined
      ? { id: "least", name: t.least, value: `${percent(frame.batteryLeast)} ${least}`, hint: t.leastHint }
      : null,
    Number.isFinite(frame.batteryMedian) ? { id: "median", name: t.median, value: percent(frame.batteryMedian), hint: t.medianHint } : null,
    first >= 0 && ids[first] !== undefined
      ? { id: "low", name: t.low, value: `${roughly(frame.low_s[first]!)} ${ids[first]}`, hint: t.lowHint(roughly(frame.empty_s[first]!)) }
      : null,
    Number.isFinite(frame.assembled_s) ? { id: "assembled", name: t.assembled, value: roughly(frame.assembled_s), hint: t.assembledHint } : null,
    Number.isFinite(frame.home_s) ? { id: "home", name: t.home, value: roughly(frame.home_s), hint: t.homeHint } : null,
  ];
  return all.filter((each) => each !== null);
}

/** Row of the vehicle with the first low battery; -1: unknown. */
function firstLow({ low_s }: Frame): number {
  let first = -1;
  low_s.forEach((left_s, i) => {
    if (Number.isFinite(left_s) && (first < 0 || left_s < low_s[first]!)) first = i;
  });
  return first;
}

/** An estimate looks like one: "~45 s", "~3 min"; what is over is "now". */
export function roughly(left_s: number): string {
  if (!Number.isFinite(left_s)) return texts.energy.unknown;
  if (left_s < 1) return t.now;
  if (left_s < 90) return `~${Math.round(left_s)} s`;
  return left_s < 600 ? `~${minutes(10 * Math.round(left_s / 10))} min` : `~${Math.round(left_s / 60)} min`;
}

export function energy({ frame, status }: State): TemplateResult | typeof nothing {
  if (frame === null || status === null) return nothing;
  const all = entries(frame, status.vehicles.map((each) => each.id));
  if (all.length === 0) return nothing;
  return html`<dl class="energy" aria-label=${t.title} data-testid="energy">
    ${all.map((each) => html`<div title=${each.hint}><dt>${each.name}</dt><dd class="value" data-testid="energy-${each.id}">${each.value}</dd></div>`)}
  </dl>`;
}
