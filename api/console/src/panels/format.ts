/** Numbers as an operator reads them. What is not known is a dash, never a zero. */

export const UNKNOWN = "–";

type Maybe = number | null | undefined;

function known(value: Maybe): value is number {
  return value !== null && value !== undefined && Number.isFinite(value);
}

/** A plain number with fixed digits. */
export function fixed(value: Maybe, digits = 1): string {
  if (!known(value)) return UNKNOWN;
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/** A number with as many digits as it has, two at most: 8, 0.5, 2.43. */
export function plain(value: Maybe): string {
  return known(value) ? String(Number(value.toFixed(2))) : UNKNOWN;
}

/** A number with its unit; the unit goes with what is known only. */
export function withUnit(value: Maybe, unit: string, digits = 1): string {
  return known(value) ? `${fixed(value, digits)} ${unit}` : UNKNOWN;
}

/** A share, 0 to 1, as percent; rounded down, so that 19.6 % never reads as 20 %. */
export function percent(share: Maybe): string {
  return known(share) ? `${Math.floor(share * 100 + 1e-3)} %` : UNKNOWN;
}

/** As above, without the percent sign, for columns whose heading has it. */
export function percentOnly(share: Maybe): string {
  return known(share) ? String(Math.floor(share * 100 + 1e-3)) : UNKNOWN;
}

/** An age or a time left, as short as it can be read. */
export function seconds(value: Maybe): string {
  if (!known(value)) return UNKNOWN;
  if (value < 10) return `${fixed(value, 1)} s`;
  if (value < 100) return `${fixed(value, 0)} s`;
  return minutes(value);
}

/** A number with its unit in gcs/model/vehicle_columns.py. */
export function measured(value: Maybe, unit: string): string {
  if (unit === "share") return percent(value);
  return unit === "s" ? seconds(value) : withUnit(value, unit);
}

/** 75.4 -> "1:15", also below zero and beyond an hour. */
export function minutes(value: Maybe): string {
  if (!known(value)) return UNKNOWN;
  const whole = Math.floor(Math.abs(value));
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (part: number): string => String(part).padStart(2, "0");
  const sign = value < 0 && whole > 0 ? "−" : "";
  return h > 0 ? `${sign}${h}:${two(m)}:${two(s)}` : `${sign}${m}:${two(s)}`;
}

/** Seconds since 1970 as the clock on the wall of this machine, "12:03:04". */
export function clockTime(unix_time_s: Maybe): string {
  if (!known(unix_time_s)) return UNKNOWN;
  return new Date(unix_time_s * 1000).toLocaleTimeString("en-GB");
}

/** The same in UTC. */
export function utcTime(unix_time_s: number): string {
  return new Date(unix_time_s * 1000).toISOString().slice(11, 19);
}

/** A name in at most so many letters, its end: there the names of a fleet differ. */
export function tail(name: string, most: number): string {
  return name.length > most ? `…${name.slice(1 - most)}` : name;
}

/** Typed text as a number; a comma is a point. null: no number. */
export function parsed(text: string): number | null {
  const trimmed = text.trim().replace(",", ".").replace("−", "-");
  if (!/^[-+]?(\d+\.?\d*|\.\d+)$/.test(trimmed)) return null;
  return Number(trimmed);
}

/** A clock time of today, or of tomorrow when it has passed, in s since 1970. null: no clock time. */
export function nextClockTime(text: string, now_unix_time_s: number): number | null {
  const match = /^([01]?\d|2[0-3]):([0-5]\d)(?::([0-5]\d))?$/.exec(text.trim());
  if (!match) return null;
  const when = new Date(now_unix_time_s * 1000);
  when.setHours(Number(match[1]), Number(match[2]), Number(match[3] ?? 0), 0);
  if (when.getTime() / 1000 <= now_unix_time_s) when.setDate(when.getDate() + 1);
  return when.getTime() / 1000;
}
