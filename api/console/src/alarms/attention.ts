// What calls the operator's attention beside the list: sound, title, icon, screen reader. Pure.

import { fresh, type State } from "../state";
import { alarmsOf, commanded, rank, raised, worst, type Alarm, type Overall, type Severity } from "./model";
import type { Attention, AttentionMessage } from "./attentionState";

export { initialAttention, type Attention, type AttentionMessage, type Ring } from "./attentionState";

/** An unacknowledged alarm sounds again after this time; other severities sound once, or never. */
export const REPEATED_MS: Partial<Record<Severity, number>> = { emergency: 4_000, warning: 20_000 };
const SOUNDING: ReadonlySet<Severity> = new Set(["emergency", "warning", "caution"]);

/** New alarms are announced and sound once. */
export function afterAlarms(attention: Attention, before: readonly Alarm[], now: readonly Alarm[], now_ms: number, isSilent: boolean): Attention {
  const fresh = commanded(raised(before, now));
  if (fresh.length === 0) return attention;
  const say = (isUrgent: boolean): string =>
    fresh
      .filter((each) => rank(each.severity) <= rank("warning") === isUrgent)
      .map((each) => `${each.severity}: ${each.text}`)
      .join(" ");
  const announced = { number: attention.announced.number + 1, urgent: say(true), calm: say(false) };
  return rung({ ...attention, announced }, worst(fresh), now_ms, isSilent);
}

/** Unacknowledged alarms sound again. */
export function reminded(attention: Attention, alarms: readonly Alarm[], now_ms: number, isSilent: boolean): Attention {
  const open = worst(alarms.filter((each) => each.acknowledged_by === null));
  const every_ms = open === "normal" ? undefined : REPEATED_MS[open];
  return every_ms !== undefined && now_ms - attention.rang_ms >= every_ms ? rung(attention, open, now_ms, isSilent) : attention;
}

function rung(attention: Attention, severity: Overall, now_ms: number, isSilent: boolean): Attention {
  if (isSilent || !attention.soundOn || severity === "normal" || !SOUNDING.has(severity)) return attention;
  return { ...attention, ring: { count: attention.ring.count + 1, severity }, rang_ms: now_ms };
}

/** Behind the update of everything else; `message` is the same. */
export function updateAttention(before: State, state: State, message: { kind: string }): State {
  const attention = attended(before, state, message as AttentionMessage | { kind: "status" | "tick" | "connection" });
  return attention === state.attention ? state : { ...state, attention };
}

function attended(before: State, state: State, message: AttentionMessage | { kind: "status" | "tick" | "connection" }): Attention {
  const { attention, status, page_ms } = state;
  const isSilent = Boolean(status?.replay);
  switch (message.kind) {
    case "sound":
      return { ...attention, soundOn: message.on };
    case "sound-blocked":
      return attention.soundBlocked === message.isBlocked ? attention : { ...attention, soundBlocked: message.isBlocked, unblocked_ms: page_ms };
    case "fold-alarms":
      return { ...attention, isFolded: message.isFolded };
    case "status": {
      const isSame = before.status?.began_unix_time_s === status?.began_unix_time_s; // another service starts its alarm numbers again
      return afterAlarms(attention, isSame ? alarmsOf(before.status) : [], alarmsOf(status), page_ms, isSilent);
    }
    case "connection":
    case "tick":
      if (isCutOff(state)) return cutOff(before, state);
      return reminded(attention, alarmsOf(status), page_ms, isSilent);
    default:
      return attention;
  }
}

/** The state shown is old; the present one is unknown. */
export function isCutOff(state: State): boolean {
  const { connection, status, frame } = state;
  return status !== null && !status.replay && frame !== null && connection.kind !== "denied" && !fresh(state);
}

/** With vehicles in the air no data is as urgent as an emergency: what goes wrong now raises no alarm here. */
function cutOff(before: State, { attention, status, page_ms }: State): Attention {
  const isDue = !isCutOff(before) || page_ms - attention.rang_ms >= REPEATED_MS.warning!;
  return isDue && status!.counts.airborne > 0 ? rung(attention, "emergency", page_ms, false) : attention;
}

/** "EMERGENCY 2: Vehicle d3 lost": the worst first, for a tab that is not looked at. */
export function titleOf(title: string, alarms: readonly Alarm[]): string {
  const severity = worst(alarms);
  if (severity === "normal" || severity === "information") return title;
  const all = commanded(alarms).filter((each) => each.severity === severity && each.ended_unix_time_s === null);
  return `${severity.toUpperCase()} ${all.length}: ${headline(all[0]!.text)} · ${title}`;
}

function headline(text: string): string {
  return /^.*?[:.](?=\s|$)/.exec(text)?.[0].slice(0, -1) ?? text;
}

/** The page's icon for it. */
export function iconOf(alarms: readonly Alarm[]): "normal" | Exclude<Severity, "information"> {
  const severity = worst(alarms);
  return severity === "information" ? "normal" : severity;
}
