// What an operator can drag, and its preview where it was dragged. Pure; nothing here sends a command.

import type { Preview, Obstacle, State } from "../state";
import { may } from "../state";
import type { Vec3 } from "./axes";
import { minus, toScene, toShow } from "./axes";
import type { Ray, Screen } from "./picking";
import { facing, intoBox, onLevel, project } from "./picking";
import type { Basis, Pose } from "./rig";

/** The present view of the scene. */
export interface Sight {
  basis: Basis;
  pose: Pose;
  screen: Screen;
}

/** What is dragged, and at which part of it: offset on the ground from the pointer. */
export interface Grip {
  preview: Preview;
  /** Height of the plane on which the pointer moves it. */
  height_m: number;
  off_x_m: number;
  off_y_m: number;
}

const REACH_PX = 18;
const RADIUS_MIN_M = 0.5;

/** The smallest step that a pointer can express at this zoom: some 4 pixels or more. */
export function step_m(span_m: number, height_px: number): number {
  const least_m = (4 * span_m) / height_px;
  return least_m <= 0.1 ? 0.1 : least_m <= 0.5 ? 0.5 : least_m <= 1 ? 1 : 5;
}

export function rounded(value: number, step: number): number {
  return Number((Math.round(value / step) * step).toFixed(3));
}

/** Where the sphere can be taken hold of: its right edge, or its ghost's. */
export function handleOf(center: Vec3, radius_m: number, basis: Basis): Vec3 {
  return [center[0] + radius_m * basis.right[0], center[1], center[2] + radius_m * basis.right[2]];
}

/** The sphere's centre and radius as they stand; null while no formation flies. */
export function sphereOf(state: State): { center: Vec3; radius_m: number } | null {
  const { frame } = state;
  if (frame?.center_m == null || !(frame.radius_m > 0)) {
    return null;
  }
  return { center: toScene(...frame.center_m), radius_m: frame.radius_m };
}

/** What is under the pointer and may be dragged with the viewer's rights; null: nothing. A preview comes before its original. */
export function gripAt(state: State, sight: Sight, ray: Ray, px: number, py: number): Grip | null {
  if (!may(state, "operate") || state.frame === null || state.status === null || state.status.replay !== null) {
    return null;
  }
  return ofRadius(state, sight, px, py) ?? ofTarget(state, sight, ray, px, py) ?? ofObstacle(state, ray);
}

function ofRadius(state: State, sight: Sight, px: number, py: number): Grip | null {
  const sphere = sphereOf(state);
  if (sphere === null) {
    return null;
  }
  const radius_m = state.preview?.kind === "radius" ? state.preview.radius_m : sphere.radius_m;
  const seen = project(sight.basis, sight.pose, sight.screen, handleOf(sphere.center, radius_m, sight.basis));
  if (seen === null || Math.hypot(seen.px - px, seen.py - py) > REACH_PX) {
    return null;
  }
  return { preview: { kind: "radius", radius_m }, height_m: 0, off_x_m: 0, off_y_m: 0 };
}

function ofTarget(state: State, sight: Sight, ray: Ray, px: number, py: number): Grip | null {
  const [x_m, y_m] = state.preview?.kind === "target" ? [state.preview.x_m, state.preview.y_m] : state.frame!.target_m;
  const seen = project(sight.basis, sight.pose, sight.screen, toScene(x_m, y_m, 0));
  if (seen === null || Math.hypot(seen.px - px, seen.py - py) > REACH_PX) {
    return null;
  }
  return gripped({ kind: "target", x_m, y_m }, ray, 0);
}

function ofObstacle(state: State, ray: Ray): Grip | null {
  let nearest: Obstacle | null = null;
  let least_m = Infinity;
  for (const box of boxesOf(state)) {
    const [low, high] = cornersOf(box);
    const far_m = intoBox(ray, low, high);
    if (far_m !== null && far_m < least_m) {
      [nearest, least_m] = [box, far_m];
    }
  }
  if (nearest === null) {
    return null;
  }
  const height_m = ray.from[1] + least_m * ray.along[1];
  const { id, x_m, y_m, half_length_x_m, half_length_y_m } = nearest;
  const preview: Preview = id === NEW
    ? { kind: "new-obstacle", x_m, y_m, half_length_x_m, half_length_y_m, height_m: nearest.height_m }
    : { kind: "obstacle", id, x_m, y_m };
  return gripped(preview, ray, Math.max(0, height_m));
}

const NEW = "";

/** The obstacles as they stand, and the ghost of one before them. */
function boxesOf(state: State): Obstacle[] {
  const boxes = [...state.status!.obstacles];
  const box = previewBox(state);
  return box === null ? boxes : [box, ...boxes];
}

/** The box that the ghost is of; null when it is of none. A new one has no id yet. */
export function previewBox({ preview, status }: State): Obstacle | null {
  if (preview?.kind === "new-obstacle") {
    return { ...preview, id: NEW, velocity_x_m_s: 0, velocity_y_m_s: 0 };
  }
  if (preview?.kind === "obstacle") {
    const real = status?.obstacles.find((each) => each.id === preview.id);
    return real === undefined ? null : { ...real, x_m: preview.x_m, y_m: preview.y_m };
  }
  return null;
}

/** Low and high corner, three's axes. */
export function cornersOf(box: Obstacle): [Vec3, Vec3] {
  return [
    [box.y_m - box.half_length_y_m, 0, -box.x_m - box.half_length_x_m],
    [box.y_m + box.half_length_y_m, box.height_m, -box.x_m + box.half_length_x_m],
  ];
}

function gripped(preview: Exclude<Preview, { kind: "radius" }>, ray: Ray, height_m: number): Grip | null {
  const hand = onLevel(ray, height_m);
  if (hand === null) {
    return null;
  }
  const at = toShow(hand);
  return { preview, height_m, off_x_m: preview.x_m - at.x_m, off_y_m: preview.y_m - at.y_m };
}

/** The preview after the pointer moved; the old one where the pointer is over nothing. */
export function moved(grip: Grip, sphereCenter: Vec3 | null, sight: Sight, ray: Ray): Preview {
  const step = step_m(sight.pose.span_m, sight.screen.free.height);
  if (grip.preview.kind === "radius") {
    if (sphereCenter === null) {
      return grip.preview;
    }
    const off = minus(facing(ray, sight.basis, sphereCenter), sphereCenter);
    return { kind: "radius", radius_m: Math.max(RADIUS_MIN_M, rounded(Math.hypot(...off), step)) };
  }
  const hand = onLevel(ray, grip.height_m);
  if (hand === null) {
    return grip.preview;
  }
  const at = toShow(hand);
  return { ...grip.preview, x_m: rounded(at.x_m + grip.off_x_m, step), y_m: rounded(at.y_m + grip.off_y_m, step) };
}
