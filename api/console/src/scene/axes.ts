// The show frame as three.js sees it: x of three is the show's y, y is the height, z is minus the show's x.
// So the show's heading points away from a viewer who looks along -z, and its right is the viewer's right.

export type Vec3 = readonly [number, number, number];

export function dot(a: Vec3, b: Vec3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function minus(a: Vec3, b: Vec3): Vec3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

const DEGREE = Math.PI / 180;

/** Show frame x, y and height to three's axes. */
export function toScene(x_m: number, y_m: number, height_m: number): Vec3 {
  return [y_m, height_m, -x_m];
}

/** A place in three's axes to the show frame. */
export function toShow([x, y, z]: Vec3): { x_m: number; y_m: number; height_m: number } {
  return { x_m: -z, y_m: x, height_m: y };
}

/** Turn about three's y for a model that looks along -z, from a heading clockwise from north. */
export function turn_rad(heading_deg: number, originHeading_deg: number): number {
  return (originHeading_deg - heading_deg) * DEGREE;
}

/** Where north lies, clockwise from the show's x as seen from above. */
export function north_rad(originHeading_deg: number): number {
  return -originHeading_deg * DEGREE;
}

/** The same turn, not more than half a turn away from nothing. */
export function shortest_rad(turn: number): number {
  return turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI));
}

/** A whole number of 1, 2 or 5 times a power of ten, not less than `least`. */
export function roundStep(least: number): number {
  const power = 10 ** Math.floor(Math.log10(least));
  const share = least / power;
  return power * (share <= 1 ? 1 : share <= 2 ? 2 : share <= 5 ? 5 : 10);
}
