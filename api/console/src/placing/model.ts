/** Where a drawn show is to lie: moved and turned by hand, beside the vehicles as they stand. Pure. */

import type { PlacedShow, Placement } from "../snapshot";

export interface Placing {
  /** What the service answered last: pads, and which vehicle belongs to which of them. */
  found: PlacedShow;
  /** As it is now, on this page alone. */
  place: Placement;
  /** The page's clock when it changed last. */
  changed_ms: number;
  /** What the service is working on; empty: nothing. */
  busy: "" | "fit" | "apply";
}

export type PlacingMessage =
  /** The service's answer for `asked`; null: for what it has stored, or a fit, which are taken as they are. */
  | { kind: "placing"; found: PlacedShow | null; asked: Placement | null }
  | { kind: "placed-at"; place: Placement }
  | { kind: "placing-busy"; busy: Placing["busy"] };

/** Where a vehicle stands, and how far from its pad. */
export interface AtPad {
  id: string;
  x_m: number;
  y_m: number;
  /** Index of its pad; -1: none. */
  pad: number;
  /** NaN: no pad, or no position. */
  off_m: number;
}

export type Point = readonly [number, number];

export function updatePlacing(placing: Placing | null, message: PlacingMessage, now_ms: number): Placing | null {
  switch (message.kind) {
    case "placing": {
      const { found, asked } = message;
      if (found === null) return null;
      if (asked !== null && placing === null) return null; // closed meanwhile
      const isMoved = placing !== null && asked !== null && !same(placing.place, asked);
      return { found, place: isMoved ? placing.place : placementOf(found), changed_ms: isMoved ? placing.changed_ms : now_ms, busy: "" };
    }
    case "placed-at":
      return placing === null ? null : { ...placing, place: message.place, changed_ms: now_ms };
    case "placing-busy":
      return placing === null ? null : { ...placing, busy: message.busy };
  }
}

export function placementOf({ x_m, y_m, turn_deg }: Placement): Placement {
  return { x_m, y_m, turn_deg };
}

export function same(one: Placement, other: Placement): boolean {
  const off_deg = one.turn_deg - other.turn_deg;
  return (
    Math.abs(one.x_m - other.x_m) < 0.005 && Math.abs(one.y_m - other.y_m) < 0.005 && Math.abs(off_deg - 360 * Math.round(off_deg / 360)) < 0.005
  );
}

/** Whether what is shown is not what the service has. */
export function isChanged({ found, place }: Placing): boolean {
  return found.origin_changes || !same(place, found.stored);
}

const DEGREE = Math.PI / 180;

function turned([x, y]: Point, turn_deg: number): Point {
  const [c, s] = [Math.cos(turn_deg * DEGREE), Math.sin(turn_deg * DEGREE)];
  return [c * x - s * y, s * x + c * y];
}

/** A place under one placement, under another. */
export function carried([x, y]: Point, from: Placement, to: Placement): Point {
  const [a, b] = turned(turned([x - from.x_m, y - from.y_m], -from.turn_deg), to.turn_deg);
  return [a + to.x_m, b + to.y_m];
}

/** x and y of every pad as it lies now. */
export function padsOf({ found, place }: Placing): Point[] {
  return found.pads_m.map(([x = NaN, y = NaN]) => carried([x, y], found, place));
}

/** About this the pads are turned. */
export function middleOf(pads: readonly Point[]): Point {
  const sum = pads.reduce<Point>(([a, b], [x, y]) => [a + x, b + y], [0, 0]);
  return [sum[0] / pads.length, sum[1] / pads.length];
}

/** The same placement, turned about the pads' middle. */
export function turnedTo(placing: Placing, turn_deg: number): Placement {
  const middle = middleOf(padsOf(placing));
  const turned_deg = rounded(wrapped(turn_deg));
  const [x, y] = carried(middle, placing.place, { ...placing.place, turn_deg: turned_deg });
  return { x_m: rounded(placing.place.x_m + middle[0] - x), y_m: rounded(placing.place.y_m + middle[1] - y), turn_deg: turned_deg };
}

export function wrapped(turn_deg: number): number {
  return turn_deg - 360 * Math.round(turn_deg / 360);
}

function rounded(value: number): number {
  return Math.round(100 * value) / 100;
}

/** Root mean square and greatest of the known distances; NaN for none. */
export function residual(all: readonly AtPad[]): { rms_m: number; max_m: number } {
  const known = all.map((each) => each.off_m).filter((off_m) => Number.isFinite(off_m));
  if (known.length === 0) return { rms_m: NaN, max_m: NaN };
  return { rms_m: Math.sqrt(known.reduce((sum, off_m) => sum + off_m ** 2, 0) / known.length), max_m: Math.max(...known) };
}

/** Farther off than this, a vehicle is marked. */
export const OFF_M = 1;
