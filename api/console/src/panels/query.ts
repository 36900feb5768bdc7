/** The filter of the fleet table: a line of terms, all of which a vehicle must meet. Pure.
 *
 * `100-200 phase:hold,return station:north autopilot:px4 battery<30 age>1 fix>2 nearest<5 link<80 problem limited -ready d1`
 */

import { texts } from "../texts";
import { hasProblem, isStale, type Row } from "./rows";

export type Test = (row: Row) => boolean;

export interface Query {
  test: Test;
  problem: string; // why a term was passed over; empty when none was
}

const NUMBERS: Record<string, (row: Row) => number> = {
  battery: (row) => row.battery * 100,
  age: (row) => row.age_s,
  fix: (row) => row.fix_m,
  nearest: (row) => row.nearest_m,
  link: (row) => row.link * 100,
  height: (row) => row.height_m,
};

const WORDS: Record<string, (row: Row) => string> = {
  id: (row) => row.id,
  phase: (row) => row.phase,
  mode: (row) => row.mode,
  station: (row) => row.station.toLowerCase(),
  autopilot: (row) => row.autopilot.toLowerCase(),
  fix: (row) => row.fix.toLowerCase(),
};

const FLAGS: Record<string, Test> = {
  limited: (row) => row.limited,
  ready: (row) => row.ready,
  armed: (row) => row.armed,
  stale: isStale,
  problem: hasProblem,
  alarm: (row) => row.alarm !== "normal",
};

export const FIELDS = [...new Set([...Object.keys(WORDS), ...Object.keys(NUMBERS)])];

/** The number at the end of a vehicle's id; NaN: it has none. */
const numberOf = (row: Row): number => Number(/\d+$/.exec(row.id)?.[0] ?? NaN);

/** Raises: Error with words for the operator. */
function term(text: string): Test {
  const compared = /^([a-z]+)([<>])(.*)$/.exec(text);
  if (compared) {
    const [, field, sign, given] = compared as unknown as [string, string, string, string];
    const value = NUMBERS[field];
    const limit = Number(given);
    if (!value) throw new Error(texts.fleet.noNumberField(field, Object.keys(NUMBERS)));
    if (given === "" || Number.isNaN(limit)) throw new Error(texts.fleet.noNumber(field + sign));
    return sign === "<" ? (row) => value(row) < limit : (row) => value(row) > limit;
  }
  const numbers = /^(\d+)-(\d+)$/.exec(text)?.slice(1).map(Number);
  if (numbers) return (row) => numberOf(row) >= numbers[0]! && numberOf(row) <= numbers[1]!;
  const named = /^([a-z]+):(.*)$/.exec(text);
  if (named) {
    const [, field, given] = named as unknown as [string, string, string];
    const value = NUMBERS[field];
    if (value && given === "unknown") return (row) => Number.isNaN(value(row));
    const word = WORDS[field];
    if (!word) throw new Error(texts.fleet.noField(field, FIELDS));
    const choices = given.toLowerCase().split(",");
    return (row) => choices.includes(word(row));
  }
  return FLAGS[text] ?? ((row) => row.id.includes(text) || row.phase === text || row.mode === text);
}

export function parseQuery(text: string): Query {
  const tests: Test[] = [];
  let problem = "";
  for (const part of text.split(/\s+/).filter((each) => each !== "")) {
    const denied = part.startsWith("-") && part.length > 1;
    try {
      const test = term(denied ? part.slice(1) : part);
      tests.push(denied ? (row) => !test(row) : test);
    } catch (error) {
      problem ||= (error as Error).message;
    }
  }
  return { test: (row) => tests.every((test) => test(row)), problem };
}

export function hasTerm(text: string, desired: string): boolean {
  return text.split(/\s+/).includes(desired);
}

/** The filter with a term more, or without it if it was there. */
export function toggled(text: string, desired: string): string {
  const parts = text.split(/\s+/).filter((each) => each !== "");
  const left = parts.filter((each) => each !== desired);
  return (left.length < parts.length ? left : [...parts, desired]).join(" ");
}
