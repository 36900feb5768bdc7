// Which vehicles are close to each other, in the metric in which the safety filter's ellipsoid is a sphere.

import type { Frame } from "../state";
import { PHASES } from "../state";

/** Semi-axes, centre to centre, that no pair may be within; pairs that are both lower than the pads' height do not count. */
export interface Floor {
  horizontal_m: number;
  vertical_m: number;
  pad_height_m: number;
}

export interface Pair {
  first: number;
  second: number;
  distance_m: number;
  /** 1: at the floor, less: within it. */
  proximity: number;
}

/** Pairs are shown from here on, in floors. */
export const CLOSE = 1.5;

const FLYING = new Set(["takeoff", "hold", "formation", "return", "landing", "lost", "pilot"]);
const IN_AIR: readonly boolean[] = PHASES.map((phase) => FLYING.has(phase));

/** Pairs nearer than `CLOSE` floors, the closest first, not more than `most`. */
export function closePairs(frame: Frame, floor: Floor, most = 200): Pair[] {
  const stretch = floor.horizontal_m / floor.vertical_m;
  const reach_m = CLOSE * floor.horizontal_m;
  const cells = new Map<number, number[]>();
  const found: Pair[] = [];
  for (let i = 0; i < frame.n; i += 1) {
    const x = frame.x_m[i]!;
    const y = frame.y_m[i]!;
    const h = frame.height_m[i]!;
    if (!Number.isFinite(x + y + h) || IN_AIR[frame.phase[i]!] !== true) {
      continue;
    }
    const column = Math.floor(x / reach_m);
    const row = Math.floor(y / reach_m);
    for (let k = 0; k < 9; k += 1) {
      for (const j of cells.get(cell(column + (k % 3) - 1, row + Math.floor(k / 3) - 1)) ?? []) {
        const dx = x - frame.x_m[j]!;
        const dy = y - frame.y_m[j]!;
        const dh = h - frame.height_m[j]!;
        const proximity = Math.hypot(dx, dy, dh * stretch) / floor.horizontal_m;
        const low = h < floor.pad_height_m && frame.height_m[j]! < floor.pad_height_m;
        if (proximity < CLOSE && !low) {
          found.push({ first: j, second: i, distance_m: Math.hypot(dx, dy, dh), proximity });
        }
      }
    }
    const here = cell(column, row);
    const others = cells.get(here);
    if (others === undefined) {
      cells.set(here, [i]);
    } else {
      others.push(i);
    }
  }
  return found.sort((a, b) => a.proximity - b.proximity).slice(0, most);
}

/** One number for a square of the ground. */
function cell(column: number, row: number): number {
  return column * 1_000_003 + row;
}
