import { expect, test } from "vitest";

import { obstacles } from "../src/panels/obstacles";
import { previewBar } from "../src/panels/preview";
import { toScene } from "../src/scene/axes";
import { editedBox, NEW } from "../src/obstacle";
import { boxHandles, gripAt, handleOf, moved, placedAt, rounded, step_m, type Grip, type Sight } from "../src/scene/dragPreviews";
import { project, rayThrough, type Screen } from "../src/scene/picking";
import { basisOf, START } from "../src/scene/rig";
import { initial, type Obstacle, type Right, type State } from "../src/state";
import { texts } from "../src/texts";
import { frame } from "./frames";
import { access, page, settled } from "./pages";
import { textOf } from "./pressing";
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
  expect(grip.of).toEqual({ kind: "target", x_m: 1.5, y_m: -2.5 });
  const preview = moved(grip, null, SIGHT, rayAt(11.5, 7.5, 0).ray);
  expect(preview).toEqual({ kind: "target", x_m: 11.5, y_m: 7.5 });
});

test("a hand that points at the sky leaves the ghost where it was", () => {
  const grip = gripOn(stateWith(), [1.5, -2.5, 0])!;
  expect(moved(grip, null, SIGHT, { from: [0, 10, 0], along: [0, 1, 0] })).toEqual(grip.of);
});

test("the radius follows the hand from the sphere's edge, and never goes through its centre", () => {
  const state = stateWith();
  const center = toScene(0, 0, 20);
  const grip = gripAt(state, SIGHT, rayAt(0, 0, 20).ray, 0, 0);
  expect(grip).toBeNull(); // away from the edge
  const at = project(SIGHT.basis, SIGHT.pose, SCREEN, handleOf(center, 10, SIGHT.basis))!;
  const held = gripAt(state, SIGHT, rayThrough(SIGHT.basis, SIGHT.pose, SCREEN, at.px, at.py), at.px, at.py)!;
  expect(held.of).toEqual({ kind: "radius", radius_m: 10 });
  const farther = project(SIGHT.basis, SIGHT.pose, SCREEN, handleOf(center, 14, SIGHT.basis))!;
  const preview = moved(held, center, SIGHT, rayThrough(SIGHT.basis, SIGHT.pose, SCREEN, farther.px, farther.py));
  expect(preview).toEqual({ kind: "radius", radius_m: 14 });
  expect(moved(held, center, SIGHT, rayAt(0, 0, 20).ray)).toEqual({ kind: "radius", radius_m: 0.5 });
});

test("an obstacle moves by what the hand moved, not to where it points", () => {
  const grip = gripOn(stateWith(), [8, -6, 12])!; // its roof
  const dragged = moved(grip, null, SIGHT, rayAt(12, -5, grip.height_m).ray);
  expect(dragged).toEqual({ kind: "box", id: "tower", change: { x_m: 12, y_m: -5 } });
  const nowhere = moved(grip, null, SIGHT, { from: [0, 30, 0], along: [0, 1, 0] });
  expect(nowhere).toEqual({ kind: "box", id: "tower", change: {} });
});

test("a ghost is taken hold of again, before what it is of", () => {
  const state = stateWith({ preview: { kind: "target", x_m: 15, y_m: 15 } });
  expect(gripOn(state, [15, 15, 0])!.of).toEqual({ kind: "target", x_m: 15, y_m: 15 });
  expect(gripOn(state, [1.5, -2.5, 0])).toBeNull();
});

/** Somebody edits it: what was typed or dragged is in the fields of its form. */
const editing = (id: string, drafts: Record<string, string> = {}): State => {
  const state = stateWith();
  return { ...state, panels: { ...state.panels, editing: id, drafts } };
};
const AT: Record<string, string> = { "obstacle:x_m": "-9", "obstacle:y_m": "12" };

test("the ghost of an obstacle is what its form says, and what is no number yet does not count", () => {
  expect(editedBox(stateWith())).toBeNull();
  expect(editedBox(editing("gone"))).toBeNull();
  expect(editedBox(editing("tower", { "obstacle:x_m": "1,5", "obstacle:height_m": "1x" }))).toEqual({ ...TOWER, x_m: 1.5 });
  expect(editedBox(editing(NEW, AT))).toMatchObject({ id: NEW, x_m: -9, y_m: 12, half_length_x_m: 2, height_m: 10 });
});

test("a new obstacle is placed by a press, and drawn by a drag as long as it has no place", () => {
  expect(placedAt(editing(NEW), SIGHT, rayAt(3, 4, 0).ray)).toEqual({ kind: "box", id: NEW, change: { x_m: 3, y_m: 4 } });
  expect(placedAt(editing("tower"), SIGHT, rayAt(3, 4, 0).ray)).toBeNull();
  const grip = gripOn(editing(NEW), [3, 4, 0])!;
  const drawn = moved(grip, null, SIGHT, rayAt(9, 2, 0).ray);
  expect(drawn).toEqual({ kind: "box", id: NEW, change: { x_m: 6, y_m: 3, half_length_x_m: 3, half_length_y_m: 1 } });
  expect(gripOn(editing(NEW, AT), [30, 40, 0])).toBeNull(); // the camera turns again
});

test("the handles of an obstacle size it: a side moves alone, the top changes the height", () => {
  const state = editing("tower");
  const part = (kind: string, side?: readonly number[]) => boxHandles(TOWER, SIGHT).find((each) => each.part.kind === kind && (!side || String((each.part as { side?: unknown }).side) === String(side)))!;
  const [x, , z] = part("side", [0, 1]).place;
  expect([x, z]).toEqual([-3, -8]); // y = -6 + 3
  const { px, py, ray } = rayAt(8, -3, 0);
  const side = gripAt(state, SIGHT, ray, px, py)!;
  expect(moved(side, null, SIGHT, rayAt(8, -1, 0).ray)).toEqual({ kind: "box", id: "tower", change: { y_m: -5, half_length_y_m: 4 } });
  const roof = rayAt(8, -6, 12);
  const top = gripAt(state, SIGHT, roof.ray, roof.px, roof.py)!;
  expect(moved(top, null, SIGHT, rayAt(8, -6, 17).ray)).toEqual({ kind: "box", id: "tower", change: { height_m: 17 } });
  expect(moved(top, null, SIGHT, rayAt(8, -6, 0).ray)).toEqual({ kind: "box", id: "tower", change: { height_m: 0.5 } });
  expect(boxHandles(TOWER, { basis: basisOf({ ...START, elevation: Math.PI / 2 }) }).map((each) => each.part.kind)).toEqual(Array(4).fill("side"));
});

test("what is shaped in the scene is in the form, and goes out as one obstacle", async () => {
  const { calls, actions, state } = page(stateWith(), () => ({}), "");
  actions.shapeObstacle("tower", { x_m: 9 });
  actions.shapeObstacle("tower", { height_m: 14 });
  expect(state().panels).toMatchObject({ editing: "tower", drafts: { "obstacle:x_m": "9", "obstacle:height_m": "14" } });
  expect(textOf(previewBar(state(), actions))).toContain("Obstacle tower at x 9.0 m, y -6.0 m: 4.0 m × 6.0 m, 14.0 m high");
  expect(textOf(obstacles(state(), actions))).toContain(texts.obstacles.drag);
  actions.confirmPreview();
  await settled();
  expect(calls).toMatchObject([{ call: "PUT /api/v1/obstacles/{obstacle_id}", body: { ...TOWER, x_m: 9, height_m: 14 } }]);
  expect(state().panels).toMatchObject({ editing: null, drafts: {} });
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
