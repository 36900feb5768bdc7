// The camera, pure: where it looks from, where it should, and how it gets there. A view from above or from the side
// has a long lens, so that metres are nearly the same everywhere in it.

import type { Camera } from "../state";
import type { Vec3 } from "./axes";
import type { Screen } from "./screen";
import { dot, minus, shortest_rad } from "./axes";

/** A camera around a point. Angles in radians, the rest in metres, three's axes. */
export interface Pose {
  focus: Vec3;
  /** Where it looks, clockwise from the show's x. */
  azimuth: number;
  /** How far above the horizon it stands. */
  elevation: number;
  /** How much is seen from top to bottom at the focus. */
  span_m: number;
  /** Of the lens, from top to bottom. */
  angle: number;
}

/** The camera's own axes, and its place. */
export interface Basis {
  eye: Vec3;
  right: Vec3;
  up: Vec3;
  forward: Vec3;
}

const DEGREE = Math.PI / 180;
const SPAN_MIN_M = 2;
const SPAN_MAX_M = 50_000;
const LOWEST = 1.5 * DEGREE;
const HIGHEST = 90 * DEGREE;
const LENS: Readonly<Record<Camera, number>> = { orbit: 38 * DEGREE, top: 9 * DEGREE, side: 9 * DEGREE, follow: 46 * DEGREE };
/** Time constants: of a move by hand, and of one that the camera makes by itself. */
export const EASE_S = 0.11;
export const SLOW_EASE_S = 0.5;
const FITS = 6; // rounds; each comes closer to the middle
const SPAN_LEAST_M = 12;

export const START: Pose = {
  focus: [0, 10, 0], azimuth: 0.45, elevation: 15 * DEGREE, span_m: 80, angle: LENS.orbit,
};

export function distance_m(pose: Pose): number {
  return pose.span_m / (2 * Math.tan(pose.angle / 2));
}

export function basisOf(pose: Pose): Basis {
  const [sa, ca] = [Math.sin(pose.azimuth), Math.cos(pose.azimuth)];
  const [se, ce] = [Math.sin(pose.elevation), Math.cos(pose.elevation)];
  const forward: Vec3 = [sa * ce, -se, -ca * ce];
  const away = distance_m(pose);
  const eye: Vec3 = [
    pose.focus[0] - away * forward[0],
    Math.max(0.3, pose.focus[1] - away * forward[1]), // never below the ground
    pose.focus[2] - away * forward[2],
  ];
  return { eye, right: [ca, 0, sa], up: [sa * se, ce, -ca * se], forward };
}

/** A step of `dt_s` towards the goal; the goal itself when it is as good as there. */
export function approach(pose: Pose, goal: Pose, dt_s: number, ease_s = EASE_S): Pose {
  const share = 1 - Math.exp(-dt_s / ease_s);
  const way = shortest_rad(goal.azimuth - pose.azimuth);
  const off_m = Math.hypot(...minus(goal.focus, pose.focus));
  const zoom = Math.log(goal.span_m / pose.span_m);
  const lens = goal.angle - pose.angle;
  const rest = Math.abs(way) + Math.abs(goal.elevation - pose.elevation) + off_m / goal.span_m + Math.abs(zoom) + Math.abs(lens);
  if (rest < 1e-3) {
    return goal;
  }
  return {
    focus: [
      pose.focus[0] + share * (goal.focus[0] - pose.focus[0]),
      pose.focus[1] + share * (goal.focus[1] - pose.focus[1]),
      pose.focus[2] + share * (goal.focus[2] - pose.focus[2]),
    ],
    azimuth: pose.azimuth + share * way,
    elevation: pose.elevation + share * (goal.elevation - pose.elevation),
    span_m: pose.span_m * Math.exp(share * zoom),
    angle: pose.angle + share * lens,
  };
}

export function turned(goal: Pose, azimuth: number, elevation: number): Pose {
  return {
    ...goal,
    azimuth: goal.azimuth + azimuth,
    elevation: Math.min(HIGHEST, Math.max(LOWEST, goal.elevation + elevation)),
  };
}

export function zoomed(goal: Pose, factor: number): Pose {
  return { ...goal, span_m: Math.min(SPAN_MAX_M, Math.max(SPAN_MIN_M, goal.span_m * factor)) };
}

/** Move over the ground, or, where the ground is seen from its edge, up and down; right and up are shares of the span. */
export function panned(goal: Pose, right: number, up: number): Pose {
  const [x, y, z] = goal.focus;
  const [sa, ca] = [Math.sin(goal.azimuth), Math.cos(goal.azimuth)];
  const along_m = right * goal.span_m;
  const other_m = up * goal.span_m;
  if (goal.elevation < 12 * DEGREE) {
    return { ...goal, focus: [x + along_m * ca, Math.max(0, y + other_m), z + along_m * sa] };
  }
  return { ...goal, focus: [x + along_m * ca + other_m * sa, y, z + along_m * sa - other_m * ca] };
}

/** What another camera begins with. North is up in the view from above. */
export function entered(camera: Camera, goal: Pose, north: number): Pose {
  const angle = LENS[camera];
  switch (camera) {
    case "top":
      return { ...goal, angle, azimuth: north, elevation: HIGHEST };
    case "side":
      return { ...goal, angle, elevation: 3 * DEGREE };
    case "orbit":
      return { ...goal, angle, elevation: Math.min(55 * DEGREE, Math.max(START.elevation, goal.elevation)) };
    case "follow":
      return { ...goal, angle, elevation: 18 * DEGREE };
  }
}

/** What a fit leaves free on each side of the visible region, in CSS pixels: for names, and for what moves on. */
export function fitMargin_px({ free }: Screen): number {
  const side_px = Math.min(free.width, free.height);
  return Math.min(0.3 * side_px, 0.08 * side_px + 20);
}

/**
 * The same view, moved and zoomed so that all places lie in the visible region, `fitMargin_px` from its edges.
 * Places that are not finite do not count.
 */
export function framed(goal: Pose, all: Iterable<Vec3>, screen: Screen): Pose {
  const places = [...all].filter((place) => Number.isFinite(place[0] + place[1] + place[2]));
  if (places.length === 0) {
    return goal;
  }
  const { right, up, forward } = basisOf(goal);
  const { width, height } = screen.free;
  const half = Math.tan(goal.angle / 2);
  const reach_y = (half * (height - 2 * fitMargin_px(screen))) / height;
  const reach_x = (half * (width - 2 * fitMargin_px(screen))) / height;
  let focus = goal.focus;
  const looked = (): { x: number; y: number; ahead: number }[] =>
    places.map((place) => {
      const off = minus(place, focus);
      return { x: dot(off, right), y: dot(off, up), ahead: dot(off, forward) };
    });
  const farEnough_m = (seen: ReturnType<typeof looked>): number =>
    Math.max(SPAN_LEAST_M / (2 * half), ...seen.map(({ x, y, ahead }) => Math.max(Math.abs(y) / reach_y, Math.abs(x) / reach_x) - ahead));
  for (let round = 0; round < FITS; round += 1) {
    const seen = looked();
    const away_m = farEnough_m(seen);
    const middle = (of: (each: (typeof seen)[number]) => number): number => {
      const shares = seen.map((each) => of(each) / (away_m + each.ahead));
      return (away_m * (Math.min(...shares) + Math.max(...shares))) / 2;
    };
    const [x, y] = [middle((each) => each.x), middle((each) => each.y)];
    focus = [
      focus[0] + x * right[0] + y * up[0], Math.max(0, focus[1] + x * right[1] + y * up[1]), focus[2] + x * right[2] + y * up[2],
    ];
  }
  return zoomed({ ...goal, focus, span_m: 2 * half * farEnough_m(looked()) }, 1);
}
