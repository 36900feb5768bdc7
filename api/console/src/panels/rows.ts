/** The fleet as rows of a table: columns, order, and the rows on the screen; `query` filters them. Pure. */

import { commanded, lasts, type Overall } from "../alarms/model";
import type { Frame, Phase, Status } from "../snapshot";
import { MODES, PHASES, STALE_MS, type Mode } from "../snapshot";
import { texts } from "../texts";

export interface Row {
  index: number; // of the vehicle in status and frame
  id: string;
  phase: Phase;
  mode: Mode;
  height_m: number;
  battery: number; // 0 to 1, as everything here NaN where it is not known
  age_s: number; // of the position
  link: number; // share of positions that arrive
  fix: string; // GPS_FIX_TYPE in words
  fixIsBad: boolean; // known, and without a height: preflight fails on it
  fix_m: number; // how far off the position may be
  nearest_m: number; // distance to the nearest other one in the air
  armed: boolean;
  ready: boolean;
  limited: boolean;
  limitedBy: string;
  station: string; // that flies it; empty where one flies all, or none is known to
  autopilot: string;
  received: boolean; // ever: its values are old otherwise, and there are none yet where it was not
  alarm: Overall; // the worst that lasts and names it
}

export type Column = "id" | "phase" | "mode" | "battery" | "age" | "fix" | "nearest" | "link" | "height" | "held" | "station";

export interface Sort {
  column: Column;
  descending: boolean;
}

const FIX_3D = 3; // GPS_FIX_TYPE

export type AlarmsByVehicle = ReadonlyMap<string, Overall>;

/** The worst alarm that lasts of each vehicle that one names. */
export function alarmsByVehicle({ alarms }: Status): AlarmsByVehicle {
  const lasting = commanded(alarms).filter(lasts).reverse(); // the worst last: it stays
  return new Map(lasting.flatMap(({ severity, vehicles }) => vehicles.map((id): [string, Overall] => [id, severity])));
}

export function rowOf(status: Status, frame: Frame, nearest_m: ArrayLike<number>, index: number, alarms: AlarmsByVehicle): Row {
  const vehicle = status.vehicles[index]!;
  const flags = frame.flags[index]!;
  return {
    index,
    id: vehicle.id,
    phase: PHASES[frame.phase[index]!] ?? "offline",
    mode: MODES[frame.mode[index]!] ?? "other",
    height_m: frame.height_m[index]!,
    battery: frame.battery[index]!,
    age_s: frame.position_age_s[index]!,
    link: frame.link_quality[index]!,
    fix: vehicle.fix_type === null ? "" : (texts.fixes[vehicle.fix_type] ?? String(vehicle.fix_type)),
    fixIsBad: vehicle.fix_type !== null && vehicle.fix_type < FIX_3D,
    fix_m: frame.uncertainty_m[index]!,
    nearest_m: nearest_m[index] ?? NaN,
    armed: (flags & 1) !== 0,
    ready: (flags & 2) !== 0,
    limited: (flags & 4) !== 0,
    limitedBy: vehicle.limited_by,
    station: vehicle.station ?? "",
    autopilot: vehicle.autopilot,
    received: Number.isFinite(frame.uncertainty_m[index]!),
    alarm: alarms.get(vehicle.id) ?? "normal",
  };
}

export function isStale(row: Row): boolean {
  return !(row.age_s <= STALE_MS / 1000);
}

const LOW_BATTERY = 0.3;

export const isLow = (row: Row): boolean => row.battery < LOW_BATTERY;

/** What an operator looks for among a thousand. */
export function hasProblem(row: Row): boolean {
  const isGone = row.phase === "lost" || row.phase === "killed";
  return isGone || row.fixIsBad || isLow(row) || isStale(row) || (row.alarm !== "normal" && row.alarm !== "information");
}

const byName = new Intl.Collator("en", { numeric: true });

const VALUE: Record<Exclude<Column, "id" | "station">, (row: Row) => number> = {
  phase: (row) => PHASES.indexOf(row.phase),
  mode: (row) => MODES.indexOf(row.mode),
  battery: (row) => row.battery,
  age: (row) => row.age_s,
  fix: (row) => row.fix_m,
  nearest: (row) => row.nearest_m,
  link: (row) => row.link,
  height: (row) => row.height_m,
  held: (row) => (row.limited ? 1 : 0),
};

/** Sorted; unknown values come last in both directions. */
export function sorted(rows: readonly Row[], sort: Sort): Row[] {
  const sign = sort.descending ? -1 : 1;
  const { column } = sort;
  if (column === "id") return [...rows].sort((a, b) => sign * byName.compare(a.id, b.id));
  if (column === "station") return [...rows].sort((a, b) => sign * byName.compare(a.station, b.station) || byName.compare(a.id, b.id));
  const value = VALUE[column];
  return [...rows].sort((a, b) => {
    const [u, v] = [value(a), value(b)];
    if (Number.isNaN(u) || Number.isNaN(v)) return Number(Number.isNaN(u)) - Number(Number.isNaN(v));
    return sign * (u - v) || byName.compare(a.id, b.id);
  });
}

export interface Window {
  first: number;
  last: number; // behind the last one drawn
  above_px: number;
  below_px: number;
}

const SPARE_ROWS = 6;

/** Which rows have to be drawn, and how much room the others take above and below. */
export function windowed(count: number, scroll_px: number, room_px: number, row_px: number): Window {
  const top = Math.min(Math.max(0, scroll_px), Math.max(0, count * row_px - room_px));
  const first = Math.max(0, Math.floor(top / row_px) - SPARE_ROWS);
  const last = Math.min(count, Math.ceil((top + room_px) / row_px) + SPARE_ROWS);
  return { first, last, above_px: first * row_px, below_px: (count - last) * row_px };
}
