// When the camera moves by itself, pure: what has to be in the picture, and whether it is.

import type { Phase, State } from "../state";
import { PHASES } from "../state";
import { padsOf } from "../placing/model";
import { toScene, type Vec3 } from "./axes";
import { project, type Screen } from "./picking";
import { placeOf, type Poses } from "./playback";
import { basisOf, type Pose } from "./rig";

const ON_GROUND: ReadonlySet<Phase | undefined> = new Set(["offline", "standby", "killed"]);
const FAR_M = 1000; // beyond this, and beyond three times the fence, a position is a fault that must not empty the picture
const WIDE_ORBIT = 3; // radii: a wider orbit is followed, a narrower one is in the picture as a whole
const TINY = 0.45; // of the visible region: what takes less is fitted again

/** Vehicles with a known and plausible position. */
export function believed({ status }: State, poses: Poses): number[] {
  const limit_m = Math.max(FAR_M, 3 * (status?.flight_envelope.distance_max_m ?? 0));
  return Array.from({ length: poses.n }, (_, i) => i).filter((i) => poses.known(i) && Math.hypot(...placeOf(poses, i)) < limit_m);
}

/** A drawn show is looked at, beside which nothing flies: it alone belongs in the picture. */
const isPreview = ({ drawn, placing }: State): boolean => drawn !== null && placing === null;

/** Vehicles that must stay in the picture: those of them that are not on the ground, or all where nothing flies. */
export function followed(state: State, poses: Poses): number[] {
  if (isPreview(state)) {
    return [];
  }
  const all = believed(state, poses);
  const flying = all.filter((i) => !ON_GROUND.has(PHASES[state.frame?.phase[i] ?? 0]));
  return flying.length > 0 ? flying : all;
}

/** What a fit shows: these vehicles and the sphere that flies; before it flies, pads, target and the sphere as it will be; a preview alone. */
export function* worthSeeing(state: State, poses: Poses, vehicles: readonly number[]): Generator<Vec3> {
  const { status, frame } = state;
  if (status === null || frame === null) {
    return;
  }
  if (isPreview(state)) {
    yield* state.drawn!.drawing.outline.map((place) => toScene(...place));
    return;
  }
  for (const i of vehicles) {
    yield placeOf(poses, i);
  }
  if (state.placing !== null) {
    for (const [x_m, y_m] of padsOf(state.placing)) {
      yield toScene(x_m, y_m, 0);
    }
    return;
  }
  if (state.site.edit !== null) {
    for (const { x_m, y_m } of state.site.edit.areas.flatMap((each) => each.corners)) {
      yield toScene(x_m, y_m, 0);
    }
    return;
  }
  const { radius_m, height_m } = status.formation;
  const [x_m, y_m] = frame.target_m;
  const orbit_m = status.orbit.radius_m;
  if (poses.center !== null) {
    const now_m = Number.isFinite(frame.radius_m) ? frame.radius_m : radius_m;
    yield* sphere(poses.center, now_m);
    if (orbit_m <= WIDE_ORBIT * now_m) {
      yield* sphere(toScene(x_m, y_m, poses.center[1]), now_m + orbit_m, now_m);
    }
    return;
  }
  for (const { home } of status.vehicles) {
    if (home !== null) {
      yield toScene(home.x_m, home.y_m, home.height_m);
    }
  }
  yield toScene(x_m, y_m, 0);
  yield* sphere(toScene(x_m, y_m, height_m), radius_m + (orbit_m <= WIDE_ORBIT * radius_m ? orbit_m : 0), radius_m);
}

/** The outermost places of a sphere, or of what is flatter. */
function* sphere([x, y, z]: Vec3, across_m: number, up_m = across_m): Generator<Vec3> {
  yield [x + across_m, y, z];
  yield [x - across_m, y, z];
  yield [x, y, z + across_m];
  yield [x, y, z - across_m];
  yield [x, y + up_m, z];
}

/** Nearer than this to an edge of the visible region, in CSS pixels, a vehicle is about to leave it. A fit leaves more. */
export function keepMargin_px({ free }: Screen): number {
  const side_px = Math.min(free.width, free.height);
  return Math.min(0.1 * side_px, 0.02 * side_px + 8);
}

/** Whether a place is in the visible region, that far from its edges. */
export function isVisible(pose: Pose, screen: Screen, place: Vec3, margin_px: number): boolean {
  const seen = project(basisOf(pose), pose, screen, place);
  const { left, top, width, height } = screen.free;
  return (
    seen !== null && seen.px >= left + margin_px && seen.px <= left + width - margin_px &&
    seen.py >= top + margin_px && seen.py <= top + height - margin_px
  );
}

/** Those of the vehicles that are in the visible region. */
export function visible(pose: Pose, screen: Screen, poses: Poses, vehicles: readonly number[], margin_px: number): number[] {
  return vehicles.filter((i) => isVisible(pose, screen, placeOf(poses, i), margin_px));
}

/** Whether all positions together take so little of the visible region that vehicles cannot be distinguished. */
export function isTiny(pose: Pose, screen: Screen, places: Iterable<Vec3>): boolean {
  const basis = basisOf(pose);
  const seen = [...places].map((place) => project(basis, pose, screen, place)).filter((each) => each !== null);
  if (seen.length === 0) {
    return false;
  }
  const extent = (of: (each: (typeof seen)[number]) => number): number => Math.max(...seen.map(of)) - Math.min(...seen.map(of));
  return extent(({ px }) => px) < TINY * screen.free.width && extent(({ py }) => py) < TINY * screen.free.height;
}
