import { expect, test } from "vitest";

import { toScene } from "../src/scene/axes";
import { previewBox, gripAt, handleOf, moved, rounded, step_m, type Grip, type Sight } from "../src/scene/dragPreviews";
import { project, rayThrough, type Screen } from "../src/scene/picking";
import { basisOf, START } from "../src/scene/rig";
import { initial, type Obstacle, type Right, type State } from "../src/state";
import { frame } from "./frames";
import { access } from "./pages";
import { status } from "./statuses";

const SCREEN: Screen = { width: 1200, height: 800, free: { left: 0, top: 0, width: 1200, height: 800 } };
const SIGHT: Sight = { basis: basisOf(START), pose: START, screen: SCREEN };
const TOWER: Obstacle = {
  id: "tower", x_m: 8, y_m: -6, half_length_x_m: 2, half_length_y_m: 3, height_m: 12, velocity_x_m_s: 0, velocity_y_m_s: 0,
};

function stateWith(change: Partial<State> = {}, rights: Right[] = ["operate"]): State {
  return {
    ...initial(0), status: status({ obstacles: [TOWER] }), frame: frame({ center_m: [0, 0, 20], radius_m: 10 }),
    access: access(rights), ...change,
  };
}

const rayAt = (x_m: number, y_m: number, height_m: number) => {
  const seen = project(SIGHT.basis, SIGHT.pose, SCREEN, toScene(x_m, y_m, height_m))!;
  return { px: seen.px, py: seen.py, ray: rayThrough(SIGHT.basis, SIGHT.pose, SCREEN, seen.px, seen.py) };
};

function gripOn(state: State, place: readonly [number, number, number]): Grip | null {
  const { px, py, ray } = rayAt(...place);
  return gripAt(state, SIGHT, ray, px, py);
}

test("the target is taken hold of where it is, and follows the hand over the ground", () => {
  const grip = gripOn(stateWith(), [1.5, -2.5, 0])!; // the frame's target
  expect(grip.preview).toEqual({ kind: "target", x_m: 1.5, y_m: -2.5 });
  const preview = moved(grip, null, SIGHT, rayAt(11.5, 7.5, 0).ray);
  expect(preview).toEqual({ kind: "target", x_m: 11.5, y_m: 7.5 });
});

test("a hand that points at the sky leaves the ghost where it was", () => {
  const grip = gripOn(stateWith(), [1.5, -2.5, 0])!;
  expect(moved(grip, null, SIGHT, { from: [0, 10, 0], along: [0, 1, 0] })).toEqual(grip.preview);
});

test("the radius follows the hand from the sphere's edge, and never goes through its centre", () => {
  const state = stateWith();
  const center = toScene(0, 0, 20);
  const grip = gripAt(state, SIGHT, rayAt(0, 0, 20).ray, 0, 0);
  expect(grip).toBeNull(); // away from the edge
  const at = project(SIGHT.basis, SIGHT.pose, SCREEN, handleOf(center, 10, SIGHT.basis))!;
  const held = gripAt(state, SIGHT, rayThrough(SIGHT.basis, SIGHT.pose, SCREEN, at.px, at.py), at.px, at.py)!;
  expect(held.preview).toEqual({ kind: "radius", radius_m: 10 });
  const farther = project(SIGHT.basis, SIGHT.pose, SCREEN, handleOf(center, 14, SIGHT.basis))!;
  const preview = moved(held, center, SIGHT, rayThrough(SIGHT.basis, SIGHT.pose, SCREEN, farther.px, farther.py));
  expect(preview).toEqual({ kind: "radius", radius_m: 14 });
  expect(moved(held, center, SIGHT, rayAt(0, 0, 20).ray)).toEqual({ kind: "radius", radius_m: 0.5 });
});

test("an obstacle moves by what the hand moved, not to where it points", () => {
  const grip = gripOn(stateWith(), [8, -6, 12])!; // its roof
  expect(grip.preview).toEqual({ kind: "obstacle", id: "tower", x_m: 8, y_m: -6 });
  const preview = moved(grip, null, SIGHT, rayAt(12, -5, grip.height_m).ray);
  expect(preview).toEqual({ kind: "obstacle", id: "tower", x_m: 12, y_m: -5 });
});

test("a ghost is taken hold of again, before what it is of", () => {
  const state = stateWith({ preview: { kind: "target", x_m: 15, y_m: 15 } });
  expect(gripOn(state, [15, 15, 0])!.preview).toEqual({ kind: "target", x_m: 15, y_m: 15 });
  expect(gripOn(state, [1.5, -2.5, 0])).toBeNull();
});

test("a new obstacle keeps its size while it is moved, and shows itself", () => {
  const sizes = { half_length_x_m: 2, half_length_y_m: 4, height_m: 9 };
  const state = stateWith({ preview: { kind: "new-obstacle", x_m: -9, y_m: 12, ...sizes } });
  const grip = gripOn(state, [-9, 12, 9])!;
  expect(moved(grip, null, SIGHT, rayAt(-6, 12, grip.height_m).ray)).toEqual({ kind: "new-obstacle", x_m: -6, y_m: 12, ...sizes });
  expect(previewBox(state)).toMatchObject({ x_m: -9, y_m: 12, ...sizes });
});

test("the ghost of an obstacle that is gone is none", () => {
  expect(previewBox(stateWith({ preview: { kind: "obstacle", id: "other", x_m: 0, y_m: 0 } }))).toBeNull();
  expect(previewBox(stateWith({ preview: { kind: "obstacle", id: "tower", x_m: 1, y_m: 2 } }))).toMatchObject({ ...TOWER, x_m: 1, y_m: 2 });
});

test("who may not operate, and who looks at a replay, drags nothing", () => {
  const replay = { file: "a", began_unix_time_s: 0, ended: false, skips_idle: true, speed: 1, paused: false, position_s: 0, duration_s: 9 };
  for (const place of [[1.5, -2.5, 0], [8, -6, 12]] as const) {
    expect(gripOn(stateWith({}, ["watch", "emergency"]), place)).toBeNull();
    expect(gripOn(stateWith({ access: null }), place)).toBeNull();
    expect(gripOn(stateWith({ status: status({ obstacles: [TOWER], replay }) }), place)).toBeNull();
  }
});

test("steps grow with what a pixel shows", () => {
  expect([10, 80, 150, 2000].map((span_m) => step_m(span_m, 800))).toEqual([0.1, 0.5, 1, 5]);
  expect(rounded(12.3456, 0.1)).toBe(12.3);
  expect(rounded(-12.74, 0.5)).toBe(-12.5);
});
