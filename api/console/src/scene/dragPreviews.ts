// What an operator can drag, and its preview where it was dragged. Pure; nothing here sends a command.

import { editedBox, isUnplaced, NEW, type Box } from "../obstacle";
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

/** A side of an obstacle, by the way it faces in the show frame. */
type Side = readonly [1 | -1 | 0, 1 | -1 | 0];
/** What of an obstacle is dragged; drawn: from one corner of its ground plan to the other. */
type Part = { kind: "whole" | "top" | "drawn" } | { kind: "side"; side: Side };

/** What is dragged, and at which part of it: offset from the pointer. */
export interface Grip {
  of: Preview | { kind: "box"; box: Obstacle; part: Part };
  /** Height of the plane on which the pointer moves it. */
  height_m: number;
  off_x_m: number;
  off_y_m: number;
}

/** What a drag would set: a preview, or fields of an obstacle. */
export type Dragged = Preview | { kind: "box"; id: string; change: Partial<Box> };

const REACH_PX = 18;
const RADIUS_MIN_M = 0.5;
const HALF_LENGTH_MIN_M = 0.25;
const HEIGHT_MIN_M = 0.5;
const STEEP = 0.85; // of a look from above, in which a height cannot be seen
const SIDES: readonly Side[] = [[1, 0], [-1, 0], [0, 1], [0, -1]];

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
  const isNear = (place: Vec3): boolean => {
    const seen = project(sight.basis, sight.pose, sight.screen, place);
    return seen !== null && Math.hypot(seen.px - px, seen.py - py) <= REACH_PX;
  };
  return ofDrawing(state, ray) ?? ofHandle(state, sight, ray, isNear) ?? ofRadius(state, sight, isNear) ?? ofTarget(state, ray, isNear) ?? ofObstacle(state, ray);
}

/** A new obstacle is drawn from where the pointer goes down. */
function ofDrawing(state: State, ray: Ray): Grip | null {
  const hand = isUnplaced(state) ? onLevel(ray, 0) : null;
  if (hand === null) {
    return null;
  }
  const { x_m, y_m } = toShow(hand);
  return { of: { kind: "box", box: { ...editedBox(state)!, x_m, y_m }, part: { kind: "drawn" } }, height_m: 0, off_x_m: 0, off_y_m: 0 };
}

/** The handles of the obstacle that is edited: the middle of each side on the ground, and of its top. */
export function boxHandles(box: Obstacle, { basis }: Pick<Sight, "basis">): { part: Part; place: Vec3 }[] {
  const sides = SIDES.map((side) => ({
    part: { kind: "side" as const, side },
    place: toScene(box.x_m + side[0] * box.half_length_x_m, box.y_m + side[1] * box.half_length_y_m, 0),
  }));
  if (-basis.forward[1] > STEEP) {
    return sides;
  }
  return [{ part: { kind: "top" as const }, place: toScene(box.x_m, box.y_m, box.height_m) }, ...sides];
}

function ofHandle(state: State, sight: Sight, ray: Ray, isNear: (place: Vec3) => boolean): Grip | null {
  const box = editedBox(state);
  const found = box === null || isUnplaced(state) ? undefined : boxHandles(box, sight).find(({ place }) => isNear(place));
  return found === undefined ? null : gripped({ kind: "box", box: box!, part: found.part }, toShow(found.place), ray, 0);
}

function ofRadius(state: State, sight: Sight, isNear: (place: Vec3) => boolean): Grip | null {
  const sphere = sphereOf(state);
  if (sphere === null) {
    return null;
  }
  const radius_m = state.preview?.kind === "radius" ? state.preview.radius_m : sphere.radius_m;
  if (!isNear(handleOf(sphere.center, radius_m, sight.basis))) {
    return null;
  }
  return { of: { kind: "radius", radius_m }, height_m: 0, off_x_m: 0, off_y_m: 0 };
}

function ofTarget(state: State, ray: Ray, isNear: (place: Vec3) => boolean): Grip | null {
  const [x_m, y_m] = state.preview?.kind === "target" ? [state.preview.x_m, state.preview.y_m] : state.frame!.target_m;
  return isNear(toScene(x_m, y_m, 0)) ? gripped({ kind: "target", x_m, y_m }, { x_m, y_m }, ray, 0) : null;
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
  return gripped({ kind: "box", box: nearest, part: { kind: "whole" } }, nearest, ray, Math.max(0, height_m));
}

/** The obstacles as they stand; of the one that is edited its ghost alone. */
function boxesOf(state: State): Obstacle[] {
  const box = editedBox(state);
  return [...(box === null ? [] : [box]), ...state.status!.obstacles.filter((each) => each.id !== box?.id)];
}

/** Low and high corner, three's axes. */
export function cornersOf(box: Obstacle): [Vec3, Vec3] {
  return [
    [box.y_m - box.half_length_y_m, 0, -box.x_m - box.half_length_x_m],
    [box.y_m + box.half_length_y_m, box.height_m, -box.x_m + box.half_length_x_m],
  ];
}

function gripped(of: Grip["of"], place: { x_m: number; y_m: number }, ray: Ray, height_m: number): Grip | null {
  const hand = onLevel(ray, height_m);
  const isTop = of.kind === "box" && of.part.kind === "top"; // it moves up and down, and may be seen before the sky
  if (hand === null && !isTop) {
    return null;
  }
  const at = hand === null ? place : toShow(hand);
  return { of, height_m, off_x_m: place.x_m - at.x_m, off_y_m: place.y_m - at.y_m };
}

/** What it would set after the pointer moved; what it was where the pointer is over nothing. */
export function moved(grip: Grip, sphereCenter: Vec3 | null, sight: Sight, ray: Ray): Dragged {
  const { of } = grip;
  const step = step_m(sight.pose.span_m, sight.screen.free.height);
  if (of.kind === "radius") {
    if (sphereCenter === null) {
      return of;
    }
    const off = minus(facing(ray, sight.basis.forward, sphereCenter), sphereCenter);
    return { kind: "radius", radius_m: Math.max(RADIUS_MIN_M, rounded(Math.hypot(...off), step)) };
  }
  if (of.kind === "box" && of.part.kind === "top") {
    const { id, x_m, y_m, height_m } = of.box;
    const [ahead, , aside] = sight.basis.forward;
    const [, up_m] = facing(ray, [ahead, 0, aside], toScene(x_m, y_m, height_m)); // upright
    return { kind: "box", id, change: { height_m: Math.max(HEIGHT_MIN_M, rounded(up_m, step)) } };
  }
  const hand = onLevel(ray, grip.height_m);
  if (hand === null) {
    return of.kind === "box" ? { kind: "box", id: of.box.id, change: {} } : of;
  }
  const at = toShow(hand);
  const [x_m, y_m] = [rounded(at.x_m + grip.off_x_m, step), rounded(at.y_m + grip.off_y_m, step)];
  return of.kind === "box" ? { kind: "box", id: of.box.id, change: boxChange(of.box, of.part, x_m, y_m, step) } : { ...of, x_m, y_m };
}

/** An obstacle whose part was dragged there: the side opposite of a side stays where it is. */
function boxChange(box: Obstacle, part: Part, x_m: number, y_m: number, step: number): Partial<Box> {
  const between = (from: number, to: number): [number, number] => [rounded((from + to) / 2, 0.01), Math.max(HALF_LENGTH_MIN_M, rounded(Math.abs(to - from) / 2, 0.01))];
  if (part.kind === "side") {
    const [sx, sy] = part.side;
    const [middle, half] = sx !== 0 ? between(box.x_m - sx * box.half_length_x_m, x_m) : between(box.y_m - sy * box.half_length_y_m, y_m);
    return sx !== 0 ? { x_m: middle, half_length_x_m: half } : { y_m: middle, half_length_y_m: half };
  }
  if (part.kind === "whole") {
    return { x_m, y_m };
  }
  const [middleX, halfX] = between(rounded(box.x_m, step), x_m);
  const [middleY, halfY] = between(rounded(box.y_m, step), y_m);
  return { x_m: middleX, y_m: middleY, half_length_x_m: halfX, half_length_y_m: halfY };
}

/** Where a press on the ground puts a new obstacle; null: on nothing, or none is added. */
export function placedAt(state: State, sight: Sight, ray: Ray): Dragged | null {
  const hand = state.panels.editing === NEW && may(state, "operate") ? onLevel(ray, 0) : null;
  if (hand === null) {
    return null;
  }
  const step = step_m(sight.pose.span_m, sight.screen.free.height);
  const { x_m, y_m } = toShow(hand);
  return { kind: "box", id: NEW, change: { x_m: rounded(x_m, step), y_m: rounded(y_m, step) } };
}
