/** What lies along a timeline: the phases and cues of a flight, a record or a show that has yet to fly, and marks. Pure. */

import type { Severity } from "../alarms/model";
import type { Drawing } from "../drawn/model";
import { minutes } from "../panels/format";
import type { FlightMarks, SelectedShow, ShowPhase, State } from "../state";

export type MarkKind = Severity | "error" | "notice" | "command";

export interface Part {
  phase: ShowPhase;
  cue: string | null; // null: the phase alone
  from_s: number;
  until_s: number;
  isGuess: boolean; // how long it takes is not known
}

export interface Mark {
  at_s: number;
  kind: MarkKind;
  text: string;
  alarm: string | null; // its id
  isCommanded: boolean; // a command is among them
}

export interface Course {
  now_s: number;
  duration_s: number;
  parts: readonly Part[];
  marks: FlightMarks | null;
  idle: FlightMarks["idle"];
  /** While the show lights the vehicles; null: that is not known. */
  lit: { from_s: number; until_s: number } | null;
}

type Span = Omit<Part, "cue">;
type Cues = readonly { cue: string; at_s: number }[];

export const GROUND: readonly ShowPhase[] = ["idle", "countdown", "landed"];
const BEFORE: readonly ShowPhase[] = ["preflight", "arming", "assembling"];
const PLAYS: readonly ShowPhase[] = ["running", "paused"];
const ROUNDED_S = 5; // a whole that changes seldom lets marks stay where they are
const OPEN_S = 60; // of a flight that has no end yet
const UNKNOWN_SHARE = 0.08; // of the show: as long is drawn what is not known
const TARGET_PX = 24; // of a mark: a finger finds it; those that are nearer share a place and a hint
const SHOWN = 6; // in one mark's hint

const upTo = (step: number, value: number): number => step * Math.ceil(value / step);
const known = (value: number | undefined, other: number): number => (value !== undefined && Number.isFinite(value) ? value : other);

const within = (share: number): number => Math.min(1, Math.max(0, share));

export const percent = (share: number): string => `${(100 * within(share)).toFixed(3)}%`;

/** The running show, from cue to cue. A cue is of its flight: none of the one before a landing. */
export function cut(spans: readonly Span[], cues: Cues): Part[] {
  let ground_s = -Infinity;
  return spans.flatMap((span): Part[] => {
    if (GROUND.includes(span.phase)) ground_s = span.from_s;
    if (span.phase !== "running") return [{ ...span, cue: null }];
    const first = cues.findLast((each) => each.at_s <= span.from_s && each.at_s >= ground_s);
    const starts = [{ cue: first?.cue ?? null, at_s: span.from_s }, ...cues.filter(({ at_s }) => at_s > span.from_s && at_s < span.until_s)];
    return starts.map(({ cue, at_s }, i) => ({ ...span, cue, from_s: at_s, until_s: starts[i + 1]?.at_s ?? span.until_s }));
  });
}

const RANK: readonly MarkKind[] = ["emergency", "warning", "error", "caution", "notice", "information", "command"];

/** From the first to the last. Marks that would lie on one another become one: the gravest, where that is. */
export function marksOf({ commands, events }: FlightMarks, duration_s: number, width_px: number): Mark[] {
  const ordered = commands.map((each): Mark => ({ ...each, kind: "command", alarm: null, isCommanded: true, text: named(each) }));
  const happened = events.map((each): Mark => {
    const kind = each.alarm_severity ?? (each.severity === "error" ? "error" : "notice");
    return { ...each, kind, isCommanded: false, text: named(each) };
  });
  const all = [...ordered, ...happened].sort((a, b) => RANK.indexOf(a.kind) - RANK.indexOf(b.kind) || a.at_s - b.at_s);
  const away_px = (a: Mark, b: Mark): number => width_px * Math.abs(within(a.at_s / duration_s) - within(b.at_s / duration_s));
  const groups: [Mark, ...Mark[]][] = [];
  for (const each of all) {
    const near = groups.filter(([gravest]) => away_px(gravest, each) < TARGET_PX);
    if (near.length === 0) groups.push([each]);
    else near.reduce((a, b) => (away_px(b[0], each) < away_px(a[0], each) ? b : a)).push(each);
  }
  const joined = groups.map(([gravest, ...others]): Mark => {
    const texts = others.slice(0, SHOWN - 1).map(({ at_s, text }) => `${minutes(at_s)} ${text}`);
    const more = others.length - texts.length;
    const text = [gravest.text, ...texts, ...(more > 0 ? [`+ ${more}`] : [])].join("; ");
    return { ...gravest, isCommanded: [gravest, ...others].some((each) => each.isCommanded), text };
  });
  return joined.sort((a, b) => a.at_s - b.at_s);
}

const named = ({ vehicle, text }: { vehicle: string | null; text: string }): string => (vehicle === null || text.includes(vehicle) ? text : `${vehicle}: ${text}`);

const exact = (spans: FlightMarks["phases"]): Span[] => spans.map((each) => ({ ...each, isGuess: false }));

export function recordCourse(marks: FlightMarks | null, now_s: number, duration_s: number): Course {
  const parts = marks === null ? [] : cut(exact(marks.phases), marks.cues);
  return { now_s, duration_s, parts, marks, idle: marks?.idle ?? [], lit: null };
}

export function drawnCourse({ cues, duration_s }: Drawing, now_s: number): Course {
  return { now_s, duration_s, parts: cut([{ phase: "running", from_s: 0, until_s: duration_s, isGuess: false }], cues), marks: null, idle: [], lit: null };
}

/** A show that has yet to fly: its cues to scale, between a take-off and a return of unknown length. */
function planCourse(show: SelectedShow, timeline: Cues): Course {
  const least_s = UNKNOWN_SHARE * show.duration_s;
  const end_s = least_s + show.duration_s;
  const spans = [
    { phase: "arming", from_s: 0, until_s: least_s, isGuess: true },
    { phase: "running", from_s: least_s, until_s: end_s, isGuess: false },
    { phase: "returning", from_s: end_s, until_s: end_s + least_s, isGuess: true },
  ] as const;
  const lit = show.lit_until_s == null ? null : { from_s: least_s, until_s: Math.min(end_s + least_s, least_s + show.lit_until_s) };
  const parts = cut(spans, timeline.map(({ cue, at_s }) => ({ cue, at_s: at_s + least_s })));
  return { now_s: least_s + show.clock_s, duration_s: end_s + least_s, parts, marks: null, idle: [], lit };
}

/** Whether the plan is shown: of a show that is selected, on the ground, unless the last flight is looked at. */
export function isPlan({ status, marks, panels }: State): boolean {
  if (!status?.show.selected) return false;
  const { phase } = status.show;
  if (!GROUND.includes(phase)) return lastFlown(marks) === null;
  return phase !== "landed" || panels.plan || marks?.began_unix_time_s == null;
}

/** Of marks that were read before the newest flight began nothing applies to it. */
function lastFlown(marks: FlightMarks | null): FlightMarks["phases"][number] | null {
  const last = marks?.phases.at(-1);
  return last === undefined || GROUND.includes(last.phase) ? null : last;
}

/** Of a service that flies; null: nothing is selected, and nothing has flown. */
export function flightCourse(state: State): Course | null {
  const { status, frame, marks } = state;
  if (status === null) return null;
  const show = status.show.selected;
  if (show && isPlan(state)) return planCourse(show, status.timeline);
  if (marks?.began_unix_time_s == null) return null;
  const flown = exact(marks.phases);
  if (GROUND.includes(status.show.phase)) {
    const until_s = flown.at(-1)?.until_s ?? 0;
    return { ...recordCourse(marks, until_s, until_s), idle: [] };
  }
  const last = lastFlown(marks);
  return last === null ? null : liveCourse(state, marks, flown, known(frame?.unix_time_s, status.unix_time_s) - marks.began_unix_time_s);
}

/** What has been flown, and what is ahead as far as the service estimates it. */
function liveCourse({ status, frame }: State, marks: FlightMarks, flown: Span[], now_s: number): Course {
  const show = status!.show.selected;
  const last = flown.at(-1)!;
  const least_s = UNKNOWN_SHARE * (show?.duration_s ?? 0);
  const isBefore = BEFORE.includes(last.phase);
  const plays = PLAYS.includes(last.phase);
  const clock_s = known(frame?.clock_s, show?.clock_s ?? 0);
  if (isBefore) last.until_s = upTo(1, Math.max(now_s + known(frame?.assembled_s, 0), least_s));
  else last.until_s = now_s + (last.phase === "returning" ? known(frame?.home_s, 0) : 0);
  last.isGuess = isBefore || last.phase === "returning";
  const reference_s = isBefore ? last.until_s : (flown.findLast(({ phase }) => PLAYS.includes(phase))?.until_s ?? last.until_s);
  const at = (cue_s: number): number => flightTime(flown, reference_s, cue_s - clock_s);
  const spans = [...flown];
  if (show && (isBefore || plays)) {
    const end_s = reference_s + Math.max(0, show.duration_s - clock_s);
    if (last.phase === "running") last.until_s = end_s;
    else spans.push({ phase: "running", from_s: reference_s, until_s: end_s, isGuess: false });
    spans.push({ phase: "returning", from_s: end_s, until_s: end_s + upTo(1, known(frame?.home_s, least_s)), isGuess: true });
  }
  const until_s = spans.at(-1)!.until_s;
  const duration_s = show ? upTo(ROUNDED_S, until_s) : Math.max(2, Math.ceil(until_s / OPEN_S + 0.5)) * OPEN_S;
  const isLit = isBefore || plays || clock_s > (show?.duration_s ?? 0) - 1;
  const lit = show?.lit_until_s == null ? null : { from_s: at(0), until_s: Math.min(duration_s, isLit ? at(show.lit_until_s) : reference_s) };
  const cues = show ? status!.timeline.map(({ cue, at_s }, i) => ({ cue, at_s: i === 0 ? 0 : at(at_s) })) : [];
  return { now_s, duration_s, parts: cut(spans, cues), marks, idle: [], lit };
}

/** When, since the flight began, the show's clock is by so much from where it is at `reference_s`: it stands while paused. */
export function flightTime(flown: readonly Span[], reference_s: number, by_s: number): number {
  if (by_s >= 0) return reference_s + by_s;
  let left_s = -by_s;
  let at_s = reference_s;
  for (const { phase, from_s, until_s } of [...flown].reverse()) {
    if (phase !== "running") continue;
    at_s = Math.min(until_s, reference_s);
    if (left_s <= at_s - from_s) return at_s - left_s;
    left_s -= Math.max(0, at_s - from_s);
    at_s = from_s;
  }
  return at_s;
}
