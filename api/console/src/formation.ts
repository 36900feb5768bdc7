// Errors of the formation's shape in one frame. Pure.

import { PHASES, type Frame } from "./state";

const FORMATION = PHASES.indexOf("formation");

/** Vehicles that the law flies, at a known position. */
export function members(frame: Frame): number[] {
  const found: number[] = [];
  for (let i = 0; i < frame.n; i++) {
    if (frame.phase[i] === FORMATION && isPlaced(frame, i)) found.push(i);
  }
  return found;
}

export function isPlaced(frame: Frame, i: number): boolean {
  return Number.isFinite(frame.x_m[i]) && Number.isFinite(frame.y_m[i]) && Number.isFinite(frame.height_m[i]);
}

/** The largest distance of a vehicle in the formation from the sphere; NaN without a formation. */
export function radiusError_m(frame: Frame): number {
  const center = frame.center_m;
  if (center === null || !Number.isFinite(frame.radius_m)) return NaN;
  let worst = NaN;
  for (const i of members(frame)) {
    const distance_m = Math.hypot(
      (frame.x_m[i] ?? NaN) - center[0], (frame.y_m[i] ?? NaN) - center[1], (frame.height_m[i] ?? NaN) - center[2],
    );
    const off_m = Math.abs(distance_m - frame.radius_m);
    if (!(worst >= off_m)) worst = off_m;
  }
  return worst;
}

/** Mean Coulomb energy of a pair of unit charges where the vehicles are seen from the centre, on the unit sphere:
 *  1 is two vehicles at one radius's distance. The evener the shape, the lower. NaN with fewer than two. */
export function energy(frame: Frame): number {
  const center = frame.center_m;
  const who = center === null ? [] : members(frame);
  if (center === null || who.length < 2) return NaN;
  const at = new Float64Array(3 * who.length);
  who.forEach((i, k) => {
    const x = (frame.x_m[i] ?? NaN) - center[0];
    const y = (frame.y_m[i] ?? NaN) - center[1];
    const z = (frame.height_m[i] ?? NaN) - center[2];
    const r = Math.hypot(x, y, z) || 1;
    at.set([x / r, y / r, z / r], 3 * k);
  });
  let sum = 0;
  for (let a = 0; a < at.length; a += 3) {
    for (let b = a + 3; b < at.length; b += 3) {
      const x = at[a]! - at[b]!;
      const y = at[a + 1]! - at[b + 1]!;
      const z = at[a + 2]! - at[b + 2]!;
      sum += 1 / Math.sqrt(x * x + y * y + z * z);
    }
  }
  return sum / ((who.length * (who.length - 1)) / 2);
}

/** Each vehicle's distance to the nearest other one that is received; NaN without a known position. */
export function nearest_m(frame: Frame): Float64Array {
  const { n, x_m, y_m, height_m } = frame;
  const squared = new Float64Array(n).fill(Infinity);
  for (let a = 0; a < n; a++) {
    for (let b = a + 1; b < n; b++) {
      const x = x_m[a]! - x_m[b]!;
      const y = y_m[a]! - y_m[b]!;
      const z = height_m[a]! - height_m[b]!;
      const d = x * x + y * y + z * z;
      if (d < squared[a]!) squared[a] = d;
      if (d < squared[b]!) squared[b] = d;
    }
  }
  return squared.map((d) => (Number.isFinite(d) ? Math.sqrt(d) : NaN));
}
