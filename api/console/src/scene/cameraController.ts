// The camera over time: input of pointer and keys, the change from one camera to another, following, and keeping the
// formation in view. It moves automatically only when the formation leaves the view, and never during an operator's input.

import type { Camera, State } from "../state";
import { north_rad, type Vec3 } from "./axes";
import { believed, followed, isTiny, keepMargin_px, visible, worthSeeing } from "./framing";
import type { Screen } from "./picking";
import { placeOf, type Poses } from "./playback";
import { approach, EASE_S, entered, framed, panned, SLOW_EASE_S, START, turned, zoomed, type Pose } from "./rig";

const HALF_TURN = Math.PI;
const STEP_MAX_S = 0.1; // after a pause the camera does not leap
const FOLLOWED_SPAN_M = 26;
const REST_MS = 1500; // after the end of an operator's input, before the camera moves automatically
const AWAY_MS = 20_000; // how long the camera may stay where an operator left it without vehicles in view
const LEFT_OVER = 0.5; // share of the vehicles that an operator brought into view; below it all are fitted

/** An operator's pointer: it drags an object of the scene, is down on the scene, or neither. */
export type HandState = "drags" | "held" | "none";

/** A view that was left, to be found again as it was. */
interface Left {
  goal: Pose;
  chosen: readonly number[] | null;
}

export class CameraController {
  pose: Pose = START;
  #goal: Pose = START;
  #ease_s = EASE_S;
  #camera: Camera = "orbit";
  #orbit: Left | null = null;
  #followed: string | null = null;
  #last: Vec3 | null = null;
  #isFramed = false;
  #fits = 0;
  #region = "";
  #drawn_ms = 0;
  #hand_ms = -Infinity;
  #isByHand = false; // panned or zoomed: what is seen now was chosen
  #isWide = false; // the operator fitted all vehicles: the view stays that wide
  #chosen: readonly number[] | null = null; // null: the camera chooses

  /** Whether it is still on its way. */
  get moves(): boolean {
    return this.pose !== this.#goal;
  }

  turn(right: number, up: number): void {
    if (this.#camera === "top") {
      this.pan(right, up);
    } else {
      this.#byHand(turned(this.#goal, -right * HALF_TURN, -up * HALF_TURN));
    }
  }

  /** The view moves with the pointer. */
  pan(right: number, up: number): void {
    this.#byHand(panned(this.#goal, -right, -up));
    this.#isByHand = true;
  }

  zoom(factor: number): void {
    this.#byHand(zoomed(this.#goal, factor));
    this.#isByHand = true;
  }

  /** With the next picture all is framed. */
  frame(): void {
    this.#isFramed = false;
  }

  /** The pose for this frame. While an operator drags an object of the scene, the camera stands still. */
  at(state: State, poses: Poses, selected: number, screen: Screen, now_ms: number, hand: HandState = "none"): Pose {
    const dt_s = Math.min(STEP_MAX_S, Math.max(0, (now_ms - this.#drawn_ms) / 1000));
    this.#drawn_ms = now_ms;
    if (hand !== "none") {
      this.#hand_ms = now_ms;
    }
    if (state.view.camera !== this.#camera) {
      this.#enter(state.view.camera, north_rad(state.status?.origin.heading_deg ?? 0));
    }
    if (state.view.fits !== this.#fits) {
      this.#fits = state.view.fits;
      this.#isFramed = false;
    }
    if (state.status !== null && state.frame !== null) {
      this.#keep(state, poses, screen, now_ms);
    }
    this.#follow(poses, selected, state.view.selected);
    if (hand !== "drags") {
      this.pose = approach(this.pose, this.#goal, dt_s, this.#ease_s);
    }
    return this.pose;
  }

  #byHand(goal: Pose): void {
    this.#goal = goal;
    this.#ease_s = EASE_S;
    this.#hand_ms = this.#drawn_ms;
  }

  /** The orbit is found again as it was left; from above and from the side all is framed. */
  #enter(camera: Camera, north: number): void {
    if (this.#camera === "orbit") {
      this.#orbit = { goal: this.#goal, chosen: this.#chosen };
    }
    this.#camera = camera;
    this.#last = null;
    this.#ease_s = EASE_S;
    if (camera === "orbit" && this.#orbit !== null) {
      [this.#goal, this.#chosen] = [this.#orbit.goal, this.#orbit.chosen];
      return;
    }
    this.#goal = entered(camera, this.#goal, north);
    this.#chosen = null;
    this.#isFramed = this.#isFramed && camera !== "top" && camera !== "side";
  }

  /** Fit on request, when the visible region changed, and when the formation leaves it. */
  #keep(state: State, poses: Poses, screen: Screen, now_ms: number): void {
    const { left, top, width, height } = screen.free;
    const region = [screen.width, screen.height, left, top, width, height].join();
    const isOther = region !== this.#region;
    this.#region = region;
    const vehicles = followed(state, poses);
    if (!this.#isFramed) {
      this.#fit(worthSeeing(state, poses, believed(state, poses)), screen, EASE_S);
      this.#isWide = true;
      return;
    }
    const seen = visible(this.#goal, screen, poses, vehicles, keepMargin_px(screen));
    if (this.#isByHand) {
      this.#isByHand = false;
      this.#chosen = seen;
    }
    if (this.#camera === "follow" || now_ms - this.#hand_ms < REST_MS) {
      return;
    }
    if (this.#chosen !== null && this.#isLooking(this.#chosen, seen, now_ms)) {
      return;
    }
    const places = [...worthSeeing(state, poses, vehicles)];
    if (isOther || seen.length < vehicles.length || (!this.#isWide && isTiny(this.#goal, screen, places))) {
      this.#fit(places, screen, isOther ? EASE_S : SLOW_EASE_S);
    }
  }

  /** Whether what the operator chose is still what is seen. */
  #isLooking(chosen: readonly number[], seen: readonly number[], now_ms: number): boolean {
    if (chosen.length === 0) {
      return seen.length > 0 || now_ms - this.#hand_ms < AWAY_MS;
    }
    return chosen.filter((i) => seen.includes(i)).length >= LEFT_OVER * chosen.length;
  }

  #fit(places: Iterable<Vec3>, screen: Screen, ease_s: number): void {
    const isFirst = this.pose === START;
    const goal = framed(this.#goal, places, screen);
    this.#goal = isSame(goal, this.#goal) ? this.#goal : goal;
    this.#ease_s = ease_s;
    this.#isFramed = true;
    this.#isByHand = this.#isWide = false;
    this.#chosen = null;
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

/** Nearly the same view: a move there would not be visible, and cost a picture. */
function isSame(a: Pose, b: Pose): boolean {
  const off_m = Math.hypot(a.focus[0] - b.focus[0], a.focus[1] - b.focus[1], a.focus[2] - b.focus[2]);
  return off_m < 0.005 * a.span_m && Math.abs(a.span_m - b.span_m) < 0.005 * a.span_m;
}

function carried(pose: Pose, way: Vec3): Pose {
  return { ...pose, focus: [pose.focus[0] + way[0], pose.focus[1] + way[1], pose.focus[2] + way[2]] };
}
