import { expect, test } from "vitest";

import { CameraController, type HandState } from "../src/scene/cameraController";
import { believed, followed, isVisible, keepMargin_px } from "../src/scene/framing";
import type { Screen } from "../src/scene/picking";
import { placeOf, Playback, Poses } from "../src/scene/playback";
import type { Pose } from "../src/scene/rig";
import { initial, type Camera, type State } from "../src/state";
import { frame, type Vehicle } from "./frames";
import { status } from "./statuses";

/** Windows of telephones, tablets and screens, with the room that bars and panels leave in them. */
const SCREENS: readonly Screen[] = (
  [
    [360, 740, 0, 56, 360, 360], [740, 360, 0, 48, 740, 160], [390, 844, 0, 56, 390, 420], [768, 1024, 60, 56, 648, 800], [1024, 768, 328, 56, 292, 544],
    [1440, 900, 68, 56, 1304, 676], [1440, 900, 412, 56, 460, 676], [2560, 1440, 68, 56, 2424, 1216], [2560, 1440, 412, 56, 1580, 1216],
  ] as const
).map(([width, height, left, top, free_width, free_height]) => ({ width, height, free: { left, top, width: free_width, height: free_height } }));

/** The same numbers with every run. */
function random(seed: number): () => number {
  let at = seed;
  return () => {
    at = (at * 1103515245 + 12345) % 2147483648;
    return at / 2147483648;
  };
}

/** A formation anywhere within the fence, of any size, in the air or on the ground. */
function formation(next: () => number): Vehicle[] {
  const n = 1 + Math.floor(next() * 60);
  const [x_m, y_m, height_m, spread_m] = [(next() - 0.5) * 400, (next() - 0.5) * 400, next() * 90, 1 + next() * 80];
  return Array.from({ length: n }, () => ({
    x_m: x_m + (next() - 0.5) * spread_m, y_m: y_m + (next() - 0.5) * spread_m, height_m: Math.max(0, height_m + (next() - 0.5) * spread_m),
    phase: next() < 0.8 ? "formation" : "standby",
  }));
}

class Stage {
  readonly camera_controller = new CameraController();
  readonly poses = new Poses();
  #playback = new Playback();
  state: State = { ...initial(0), status: status({ orbit: { radius_m: 0, speed_m_s: 2, direction: "clockwise" } }) };
  screen: Screen;
  now_ms = 1000;

  constructor(screen: Screen) {
    this.screen = screen;
  }

  /** These vehicles for so long, at 20 pictures a second. Returns: every pose on the way. */
  show(vehicles: readonly Vehicle[], for_s = 6, hand: HandState = "none"): Pose[] {
    const poses: Pose[] = [];
    for (let k = 0; k < 20 * for_s; k += 1) {
      this.now_ms += 50;
      const one = frame({ time_s: this.now_ms / 1000, vehicles }, this.now_ms);
      this.#playback.push(one);
      this.poses.set(this.#playback.at(this.now_ms + 1000)!, 0);
      this.state = { ...this.state, frame: one };
      poses.push(this.camera_controller.at(this.state, this.poses, -1, this.screen, this.now_ms, hand));
    }
    return poses;
  }

  look(camera: Camera): void {
    this.state = { ...this.state, view: { ...this.state.view, camera } };
  }

  fit(): void {
    this.state = { ...this.state, view: { ...this.state.view, fits: this.state.view.fits + 1 } };
  }

  /** Vehicles that should be visible and are not. */
  unseen(margin_px = 0): number[] {
    return believed(this.state, this.poses).filter((i) => !isVisible(this.camera_controller.pose, this.screen, placeOf(this.poses, i), margin_px));
  }

  unseenFlying(margin_px = 0): number[] {
    return followed(this.state, this.poses).filter((i) => !isVisible(this.camera_controller.pose, this.screen, placeOf(this.poses, i), margin_px));
  }
}

test("after a fit every vehicle is in the visible region: any formation, screen and camera", () => {
  for (const [seed, screen] of SCREENS.entries()) {
    const next = random(seed + 1);
    for (const camera of ["orbit", "top", "side", "orbit"] as const) {
      for (let round = 0; round < 4; round += 1) {
        const stage = new Stage(screen);
        stage.look(camera);
        stage.show(formation(next), 1);
        stage.camera_controller.turn(next() - 0.5, next() - 0.5); // from anywhere
        stage.camera_controller.zoom(0.1 + 3 * next());
        stage.fit();
        stage.show(formation(next), 3);
        stage.fit();
        stage.show(formation(next), 3);
        expect(stage.unseen(), `${screen.width}x${screen.height} ${camera} ${round}`).toEqual([]);
        expect(stage.camera_controller.moves).toBe(false);
      }
    }
  }
});

const around = (x_m: number, spread_m = 10): Vehicle[] =>
  [0, 1, 2, 3, 4, 5].map((k) => ({ x_m: x_m + spread_m * Math.sin(k), y_m: spread_m * Math.cos(k), height_m: 25, phase: "formation" as const }));

test("at the start all is in view, and while the formation stays there the camera stands still", () => {
  const stage = new Stage(SCREENS[5]!);
  stage.show(around(0));
  expect(stage.unseen(keepMargin_px(stage.screen))).toEqual([]);
  const poses = stage.show(around(2)).concat(stage.show(around(-2)));
  expect(new Set(poses).size).toBe(1);
});

test("the camera goes after a formation that leaves the picture: smoothly, and it comes to rest", () => {
  const stage = new Stage(SCREENS[6]!);
  stage.show(around(0));
  let before = stage.camera_controller.pose;
  for (let k = 0; k <= 100; k += 1) {
    for (const pose of stage.show(around(2 * k), 0.4)) {
      const step_m = Math.hypot(...pose.focus.map((at, axis) => at - before.focus[axis]!));
      expect(step_m).toBeLessThan(0.15 * pose.span_m); // no leap
      before = pose;
    }
    expect(stage.unseenFlying()).toEqual([]);
  }
  stage.show(around(200));
  expect(stage.camera_controller.moves).toBe(false);
});

test("under a hand the camera stays, and moves after it was let go", () => {
  const stage = new Stage(SCREENS[5]!);
  stage.show(around(0));
  const held = stage.show(around(150), 4, "held");
  expect(new Set(held).size).toBe(1);
  stage.show(around(150));
  expect(stage.unseen()).toEqual([]);
});

test("a move of the camera stops while something is dragged, and ends afterwards", () => {
  const stage = new Stage(SCREENS[5]!);
  stage.show(around(0));
  stage.screen = SCREENS[0]!;
  stage.show(around(0), 0.1);
  expect(stage.camera_controller.moves).toBe(true);
  expect(new Set(stage.show(around(0), 2, "drags")).size).toBe(1);
  stage.show(around(0));
  expect(stage.camera_controller.moves).toBe(false);
  expect(stage.unseen()).toEqual([]);
});

test("what an operator chose to look at is kept until most of it has gone; a fit shows all again", () => {
  const stage = new Stage(SCREENS[5]!);
  stage.show(around(0));
  stage.camera_controller.zoom(0.45);
  const close = stage.show(around(0), 8).at(-1)!;
  expect(stage.unseen().length).toBeGreaterThan(0); // and the close look stayed
  expect(stage.show(around(0.3), 4).at(-1)).toBe(close);
  stage.show(around(80));
  expect(stage.unseen()).toEqual([]);
  stage.camera_controller.zoom(0.02); // between them, where none is seen
  stage.show(around(80), 3);
  const empty = stage.show(around(80), 10).at(-1);
  expect(stage.show(around(80), 1).at(-1)).toBe(empty);
  stage.show(around(80), 20); // but not for ever
  expect(stage.unseen()).toEqual([]);
  stage.camera_controller.zoom(0.2);
  stage.show(around(80), 3);
  stage.fit();
  stage.show(around(80), 3);
  expect(stage.unseen()).toEqual([]);
});

test("a turn by hand is no choice of what is seen: the formation is still kept in view", () => {
  const stage = new Stage(SCREENS[5]!);
  stage.show(around(0));
  stage.camera_controller.turn(0.3, 0.1);
  stage.show(around(0), 3);
  stage.show(around(150));
  expect(stage.unseen()).toEqual([]);
});

test("after a look from above or from the side the orbit is found again exactly as it was left", () => {
  const stage = new Stage(SCREENS[5]!);
  stage.show(around(0));
  stage.camera_controller.turn(0.2, 0.05);
  stage.camera_controller.zoom(1.3);
  const left = stage.show(around(0)).at(-1)!;
  for (const camera of ["top", "side", "follow"] as const) {
    stage.look(camera);
    stage.show(around(0), 3);
    expect(stage.camera_controller.pose).not.toEqual(left);
    stage.look("orbit");
    expect(stage.show(around(0)).at(-1)).toEqual(left);
  }
});

test("when a panel opens or the screen is turned, all is fitted into what is left free", () => {
  const stage = new Stage(SCREENS[5]!);
  stage.show(around(0, 30));
  for (const screen of [SCREENS[6]!, SCREENS[0]!, SCREENS[1]!]) {
    stage.screen = screen;
    stage.show(around(0, 30), 5);
    expect(stage.unseen(), `${screen.width}`).toEqual([]);
  }
});

test("an implausible position does not empty the picture; the camera does not follow vehicles on the ground", () => {
  const stage = new Stage(SCREENS[5]!);
  stage.show([...around(0), { x_m: 4_000_000, y_m: 0, height_m: 20, phase: "lost" }, { x_m: NaN, phase: "formation" }]);
  expect(stage.camera_controller.pose.span_m).toBeLessThan(150);
  stage.show([...around(150), { x_m: -150, y_m: 0, height_m: 0, phase: "standby" }]);
  const span_m = stage.camera_controller.pose.span_m;
  expect(span_m).toBeLessThan(150);
  stage.fit();
  stage.show([...around(150), { x_m: -150, y_m: 0, height_m: 0, phase: "standby" }]);
  expect(stage.unseen()).toEqual([]); // on an operator's request all vehicles are shown
  expect(stage.camera_controller.pose.span_m).toBeGreaterThan(span_m);
});
