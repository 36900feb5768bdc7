// The camera in time: what hands and keys asked for, the change from one camera to another, and following.

import type { Camera, State } from "../state";
import { north_rad, toScene, type Vec3 } from "./axes";
import type { Screen } from "./picking";
import { placeOf, type Poses } from "./playback";
import { approach, entered, framed, panned, START, turned, zoomed, type Pose } from "./rig";

const HALF_TURN = Math.PI;
const STEP_MAX_S = 0.1; // after a pause the camera does not leap
const FOLLOWED_SPAN_M = 26;

export class Cameraman {
  pose: Pose = START;
  #goal: Pose = START;
  #camera: Camera = "orbit";
  #followed: string | null = null;
  #last: Vec3 | null = null;
  #isFramed = false;
  #drawn_ms = 0;

  /** Whether it is still on its way. */
  get moves(): boolean {
    return this.pose !== this.#goal;
  }

  turn(right: number, up: number): void {
    if (this.#camera === "top") {
      this.pan(right, up);
    } else {
      this.#goal = turned(this.#goal, -right * HALF_TURN, -up * HALF_TURN);
    }
  }

  /** What is seen goes along with the hand. */
  pan(right: number, up: number): void {
    this.#goal = panned(this.#goal, -right, -up);
  }

  zoom(factor: number): void {
    this.#goal = zoomed(this.#goal, factor);
  }

  /** With the next picture all is framed. */
  frame(): void {
    this.#isFramed = false;
  }

  /** The pose of this picture. */
  at(state: State, poses: Poses, selected: number, screen: Screen, now_ms: number): Pose {
    const dt_s = Math.min(STEP_MAX_S, Math.max(0, (now_ms - this.#drawn_ms) / 1000));
    this.#drawn_ms = now_ms;
    if (state.view.camera !== this.#camera) {
      this.#camera = state.view.camera;
      this.#goal = entered(this.#camera, this.#goal, north_rad(state.status?.origin.heading_deg ?? 0));
      this.#isFramed = this.#isFramed && this.#camera !== "top" && this.#camera !== "side";
      this.#last = null;
    }
    this.#frameOnce(state, poses, screen);
    this.#follow(poses, selected, state.view.selected);
    this.pose = approach(this.pose, this.#goal, dt_s);
    return this.pose;
  }

  #frameOnce(state: State, poses: Poses, screen: Screen): void {
    if (this.#isFramed || state.status === null || state.frame === null) {
      return;
    }
    const isFirst = this.pose === START;
    this.#goal = framed(this.#goal, worthSeeing(state, poses), screen.free.width / screen.free.height);
    this.#isFramed = true;
    if (isFirst) {
      this.pose = { ...this.#goal, span_m: 1.25 * this.#goal.span_m, azimuth: this.#goal.azimuth - 0.25 };
    }
  }

  /** Stay with the selected vehicle, or with the formation: both where the camera is and where it goes move on with it. */
  #follow(poses: Poses, selected: number, id: string | null): void {
    if (this.#camera !== "follow") {
      return;
    }
    const place = selected >= 0 && poses.known(selected) ? placeOf(poses, selected) : poses.center;
    if (place === null) {
      this.#last = null;
      return;
    }
    if (this.#last === null || this.#followed !== id) {
      const span_m = selected >= 0 ? Math.min(FOLLOWED_SPAN_M, this.#goal.span_m) : this.#goal.span_m;
      this.#goal = { ...this.#goal, focus: place, span_m };
      this.#followed = id;
    } else {
      const way: Vec3 = [place[0] - this.#last[0], place[1] - this.#last[1], place[2] - this.#last[2]];
      const isThere = this.pose === this.#goal;
      this.#goal = carried(this.#goal, way);
      this.pose = isThere ? this.#goal : carried(this.pose, way);
    }
    this.#last = place;
  }
}

function carried(pose: Pose, way: Vec3): Pose {
  return { ...pose, focus: [pose.focus[0] + way[0], pose.focus[1] + way[1], pose.focus[2] + way[2]] };
}

/** Vehicles, pads, target, and the sphere as it will be, all the way round. */
function* worthSeeing({ status, frame }: State, poses: Poses): Generator<Vec3> {
  if (status === null || frame === null) {
    return;
  }
  for (let i = 0; i < poses.n; i += 1) {
    yield placeOf(poses, i);
  }
  for (const { home } of status.vehicles) {
    if (home !== null) {
      yield toScene(home.x_m, home.y_m, home.height_m);
    }
  }
  const [x_m, y_m] = frame.target_m;
  yield toScene(x_m, y_m, 0);
  const { radius_m, height_m } = status.formation;
  const around_m = radius_m + status.orbit.radius_m;
  for (const [ahead, right] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
    yield toScene(x_m + ahead * around_m, y_m + right * around_m, height_m);
  }
  yield toScene(x_m, y_m, height_m + radius_m);
}
