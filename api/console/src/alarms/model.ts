// Alarms as the service lists them: in which order they are shown, and how severe the whole is. Pure.

import type { Status } from "../snapshot";
import type { components } from "../schemas/schema";

export const SEVERITIES = ["emergency", "warning", "caution", "information"] as const satisfies readonly Severity[];
export type Severity = components["schemas"]["AlarmSeverity"];
/** Of the whole; normal: no alarm lasts. */
export type Overall = Severity | "normal";

export type Alarm = components["schemas"]["Alarm"];

/** Never folded away, however many there are. */
export const ALWAYS_SHOWN: ReadonlySet<Severity> = new Set(["emergency", "warning"]);

export const rank = (severity: Overall): number => (severity === "normal" ? SEVERITIES.length : SEVERITIES.indexOf(severity));

/** Those that last before those that have ended, the most severe first, of these the newest. */
export function commanded(alarms: readonly Alarm[]): Alarm[] {
  return [...alarms].sort(
    (a, b) =>
      Number(a.ended_unix_time_s !== null) - Number(b.ended_unix_time_s !== null) ||
      rank(a.severity) - rank(b.severity) ||
      b.raised_unix_time_s - a.raised_unix_time_s,
  );
}

export const isOpen = (alarm: Alarm): boolean => alarm.acknowledged_by === null;
/** The service refuses to acknowledge that control has stopped: this stays on top until control runs again. */
export const mayAcknowledge = (alarm: Alarm): boolean => isOpen(alarm) && alarm.cause !== "control-stopped";
export const lasts = (alarm: Alarm): boolean => alarm.ended_unix_time_s === null;

/** The command that an alarm advises to the whole show; null: it advises none, or one to its vehicles. */
export function showCommand({ action, vehicles }: Alarm): "pause" | "stop" | null {
  if (action === "return" && vehicles.length === 0) return "stop";
  return action === "pause" || action === "stop" ? action : null;
}

export function worst(alarms: readonly Alarm[]): Overall {
  return SEVERITIES.find((severity) => alarms.some((each) => lasts(each) && each.severity === severity)) ?? "normal";
}

/** How many there are of each severity, the most severe first; none of what there is none of. */
export function counted(alarms: readonly Alarm[]): { severity: Severity; count: number }[] {
  return SEVERITIES.map((severity) => ({ severity, count: alarms.filter((each) => each.severity === severity).length })).filter(
    ({ count }) => count > 0,
  );
}

/** The alarms of `now` that are new since `before`, that concern a further vehicle or have become more severe. */
export function raised(before: readonly Alarm[], now: readonly Alarm[]): Alarm[] {
  const known = new Map(before.map((each) => [each.id, each]));
  return now.filter((each) => {
    const last = known.get(each.id);
    if (!lasts(each)) return false;
    return last === undefined || each.raised_unix_time_s > last.raised_unix_time_s || rank(each.severity) < rank(last.severity);
  });
}

export function alarmsOf(status: Status | null): readonly Alarm[] {
  return status?.alarms ?? [];
}
