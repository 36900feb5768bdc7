// What is under the pointer, pure. Rays and places in three's axes, the screen in CSS pixels from its upper left.

import { dot, minus, type Vec3 } from "./axes";
import type { Basis, Pose } from "./rig";
import type { Screen } from "./screen";
import type { Rect } from "./selectionBox";

export type { Screen } from "./screen";

export interface Ray {
  from: Vec3;
  /** Of length 1. */
  along: Vec3;
}

/** The middle of what is free. */
export function middleOf({ free }: Screen): { px: number; py: number } {
  return { px: free.left + free.width / 2, py: free.top + free.height / 2 };
}

/** How much one pixel shows, for each metre that it is away. */
export function perPixel(pose: Pose, screen: Screen): number {
  return (2 * Math.tan(pose.angle / 2)) / screen.free.height;
}

/** The line of sight through a point of the screen. */
export function rayThrough(basis: Basis, pose: Pose, screen: Screen, px: number, py: number): Ray {
  const middle = middleOf(screen);
  const right = (px - middle.px) * perPixel(pose, screen);
  const up = (middle.py - py) * perPixel(pose, screen);
  const along: Vec3 = [
    basis.forward[0] + right * basis.right[0] + up * basis.up[0],
    basis.forward[1] + right * basis.right[1] + up * basis.up[1],
    basis.forward[2] + right * basis.right[2] + up * basis.up[2],
  ];
  const length = Math.hypot(...along);
  return { from: basis.eye, along: [along[0] / length, along[1] / length, along[2] / length] };
}

/** Where on the screen a place is, and how far ahead; null behind the camera. */
export function project(basis: Basis, pose: Pose, screen: Screen, place: Vec3): { px: number; py: number; ahead_m: number } | null {
  const off = minus(place, basis.eye);
  const ahead_m = dot(off, basis.forward);
  if (!(ahead_m > 1e-3)) {
    return null;
  }
  const middle = middleOf(screen);
  const scale = 1 / (perPixel(pose, screen) * ahead_m);
  return { px: middle.px + dot(off, basis.right) * scale, py: middle.py - dot(off, basis.up) * scale, ahead_m };
}

/** Where a ray meets the level of a height; null when it does not, or beyond `farthest_m`. */
export function onLevel(ray: Ray, height_m: number, farthest_m = 20_000): Vec3 | null {
  const far_m = (height_m - ray.from[1]) / ray.along[1];
  if (!(far_m > 0 && far_m < farthest_m)) {
    return null;
  }
  return [ray.from[0] + far_m * ray.along[0], height_m, ray.from[2] + far_m * ray.along[2]];
}

/** Where a ray meets the plane through a place across `forward`. */
export function facing(ray: Ray, forward: Vec3, place: Vec3): Vec3 {
  const far_m = dot(minus(place, ray.from), forward) / dot(ray.along, forward);
  return [ray.from[0] + far_m * ray.along[0], ray.from[1] + far_m * ray.along[1], ray.from[2] + far_m * ray.along[2]];
}

/** How far along a ray a box begins; null when it is missed. From within it: 0. */
export function intoBox(ray: Ray, low: Vec3, high: Vec3): number | null {
  let enters = 0;
  let leaves = Infinity;
  for (const axis of [0, 1, 2] as const) {
    const a = (low[axis] - ray.from[axis]) / ray.along[axis];
    const b = (high[axis] - ray.from[axis]) / ray.along[axis];
    if (Number.isNaN(a) || Number.isNaN(b)) {
      continue; // along this axis' side
    }
    enters = Math.max(enters, Math.min(a, b));
    leaves = Math.min(leaves, Math.max(a, b));
  }
  return enters <= leaves ? enters : null;
}

/** The nearest of `n` places within `reach_px` of a point of the screen, -1: none. `place` is x, y, z, turn of each. */
export function nearestPlace(
  basis: Basis, pose: Pose, screen: Screen, place: Float32Array, n: number, px: number, py: number, reach_px: number,
): number {
  let nearest = -1;
  let least_px = reach_px;
  for (let i = 0; i < n; i += 1) {
    const seen = project(basis, pose, screen, [place[4 * i]!, place[4 * i + 1]!, place[4 * i + 2]!]);
    const off_px = seen === null ? Infinity : Math.hypot(seen.px - px, seen.py - py);
    if (off_px < least_px) {
      [nearest, least_px] = [i, off_px];
    }
  }
  return nearest;
}

/** Every place that is seen within a rectangle of the screen, in order. `place` is x, y, z, turn of each. */
export function placesWithin(basis: Basis, pose: Pose, screen: Screen, place: Float32Array, n: number, rect: Rect): number[] {
  const found: number[] = [];
  for (let i = 0; i < n; i += 1) {
    const seen = project(basis, pose, screen, [place[4 * i]!, place[4 * i + 1]!, place[4 * i + 2]!]);
    const isWithin = seen !== null && seen.px >= rect.left && seen.px <= rect.right && seen.py >= rect.top && seen.py <= rect.bottom;
    if (isWithin) {
      found.push(i);
    }
  }
  return found;
}
