/** What lies along the scrubber: the show's phases as a band, time without flight, cues, alarms and warnings. Pure. */

import type { ReplayMarks } from "../state";

export interface Span {
  left: string; // percent of the record
  width: string;
}

export interface Tick {
  left: string;
  at_s: number;
  kind: "cue" | "alarm" | "warning" | "error";
  text: string;
}

const NEAR = 0.004; // of the record: ticks that are nearer than this share a place and a hint
const SHOWN = 6; // in one tick's hint

const percent = (share: number): string => `${(100 * Math.min(1, Math.max(0, share))).toFixed(3)}%`;

export function span(from_s: number, until_s: number, duration_s: number): Span {
  const [from, until] = [from_s / duration_s, until_s / duration_s];
  return { left: percent(from), width: percent(until - from) };
}

const RANK: Readonly<Record<Tick["kind"], number>> = { alarm: 0, error: 1, warning: 2, cue: 3 };

/** Cues and events where they happened, in order; those that would lie on one another become one, the gravest kind. */
export function ticks(marks: ReplayMarks, duration_s: number): Tick[] {
  const all: Tick[] = [
    ...marks.cues.map((each) => ({ left: "", at_s: each.at_s, kind: "cue" as const, text: each.cue })),
    ...marks.events.map((each) => ({
      left: "", at_s: each.at_s, kind: each.is_alarm ? ("alarm" as const) : each.severity === "error" ? ("error" as const) : ("warning" as const),
      text: each.vehicle === null || each.text.includes(each.vehicle) ? each.text : `${each.vehicle}: ${each.text}`,
    })),
  ].sort((a, b) => a.at_s - b.at_s);
  const groups: Tick[][] = [];
  for (const each of all) {
    const last = groups.at(-1);
    if (last !== undefined && (each.at_s - last[0]!.at_s) / duration_s < NEAR) last.push(each);
    else groups.push([each]);
  }
  return groups.map((group) => {
    const gravest = group.reduce((a, b) => (RANK[b.kind] < RANK[a.kind] ? b : a));
    const more = group.length - SHOWN;
    const shown = group.slice(0, SHOWN).map((each) => each.text);
    return { ...gravest, left: percent(gravest.at_s / duration_s), text: [...shown, ...(more > 0 ? [`+ ${more}`] : [])].join("; ") };
  });
}
