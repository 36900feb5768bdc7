// What stands still unless an operator changes it: pads, fence, obstacles, orbit, target. Collected again after a change.

import type { Group } from "three";

import type { Frame, Obstacle, Status } from "../state";
import { texts } from "../texts";
import { toScene, type Vec3 } from "./axes";
import { DECAL, Decals } from "./decals";
import type { Eye, Shared } from "./camera";
import { cornersOf } from "./dragPreviews";
import { ORDER } from "./materials";
import type { Overlay } from "./overlay";
import type { Palette } from "./palette";
import { Solids } from "./solids";
import { Strokes, type Style } from "./strokes";

const PAD_M = 0.9; // radius that a pad is drawn with
const TARGET_M = 1.4;
const TARGET_PX = 15;
const POSTS = 24; // of the fence
const ARROWS = 4; // on the orbit
const FENCE_FAR_M = 30; // nothing nearer to the fence: it is hardly seen
const FENCE_NEAR_M = 10; // and so near it is seen best

const SEEN_FROM_ABOVE = 1.2; // rad: there the fence lies around the formation, and its name is not in the way

/** How much the fence matters now, 0 to 1: by the vehicle that is nearest to it, sideways or below its top. Pure. */
export function fenceNearness({ x_m, y_m, height_m, n }: Frame, { distance_max_m, height_max_m }: Pick<Status["flight_envelope"], "distance_max_m" | "height_max_m">): number {
  let nearest_m = Infinity;
  for (let i = 0; i < n; i += 1) {
    const left_m = Math.min(distance_max_m - Math.hypot(x_m[i]!, y_m[i]!), height_max_m - height_m[i]!);
    if (left_m < nearest_m) nearest_m = left_m; // an unknown place is none
  }
  return Math.min(1, Math.max(0, (FENCE_FAR_M - nearest_m) / (FENCE_FAR_M - FENCE_NEAR_M)));
}

/** An obstacle at its present position, extrapolated with its velocity while the service reports it. */
export function broughtForward(box: Obstacle, since_s: number): Obstacle {
  const for_s = Math.min(Math.max(since_s, 0), 3);
  return { ...box, x_m: box.x_m + for_s * box.velocity_x_m_s, y_m: box.y_m + for_s * box.velocity_y_m_s };
}

export class Scenery {
  readonly #decals: Decals;
  readonly #ground: Strokes;
  readonly #lines: Strokes;
  readonly #boxes: Solids;
  #key = "";
  #status: Status | null = null;
  #palette: Palette | null = null;
  #fenceNearness = 0;

  constructor(shared: Shared, into: Group) {
    this.#decals = new Decals(shared);
    this.#ground = new Strokes(shared, ORDER.groundStrokes, { hidden: false });
    this.#lines = new Strokes(shared, ORDER.strokes);
    this.#boxes = new Solids(shared, ORDER.boxes, "box");
    into.add(this.#decals.mesh, this.#ground.mesh, this.#lines.mesh, this.#boxes.mesh);
  }

  draw(status: Status, frame: Frame, time_s: number, palette: Palette, eye: Eye): void {
    const [x_m, y_m] = frame.target_m;
    const size_m = Math.max(TARGET_M, TARGET_PX * eye.pixelAt_m(toScene(x_m, y_m, 0)));
    const isMoving = status.obstacles.some((each) => each.velocity_x_m_s !== 0 || each.velocity_y_m_s !== 0);
    this.#fenceNearness = Math.round(10 * fenceNearness(frame, status.flight_envelope)) / 10;
    const key = [this.#fenceNearness, x_m.toFixed(2), y_m.toFixed(2), size_m.toFixed(2), isMoving ? time_s.toFixed(2) : ""].join();
    if (status === this.#status && palette === this.#palette && key === this.#key) {
      return;
    }
    [this.#status, this.#palette, this.#key] = [status, palette, key];
    this.#decals.clear();
    this.#ground.clear();
    this.#lines.clear();
    this.#boxes.clear();
    for (const { home } of status.vehicles) {
      if (home !== null) {
        this.#decals.put(toScene(home.x_m, home.y_m, home.height_m), palette.pad, 0.55, PAD_M, DECAL.pad);
      }
    }
    this.#decals.put(toScene(x_m, y_m, 0), palette.target, 0.95, size_m, DECAL.target);
    this.#fence(status, palette);
    this.#orbit(status, x_m, y_m, palette);
    for (const box of status.obstacles) {
      this.#obstacle(broughtForward(box, time_s - status.time_s), palette);
    }
    this.#decals.commit();
    this.#ground.commit();
    this.#lines.commit();
    this.#boxes.commit();
  }

  #fence({ flight_envelope: fence }: Status, palette: Palette): void {
    const strength = 0.15 + 0.85 * this.#fenceNearness;
    const low: Style = { color: palette.fence, alpha: 0.6 * strength, width_px: 1.6 };
    const high: Style = { ...low, alpha: 0.3 * strength, width_px: 1.2 };
    const { distance_max_m, height_max_m } = fence;
    this.#ground.circle([0, 0, 0], distance_max_m, low, undefined, undefined, 180);
    this.#lines.circle([0, height_max_m, 0], distance_max_m, high, undefined, undefined, 180);
    for (let k = 0; k < POSTS; k += 1) {
      const [s, c] = [Math.sin((2 * Math.PI * k) / POSTS), Math.cos((2 * Math.PI * k) / POSTS)];
      const [x, z] = [s * distance_max_m, c * distance_max_m];
      this.#lines.line([x, 0, z], [x, height_max_m, z], { ...high, alpha: 0.2 * strength });
    }
    for (const { corners_m } of fence.areas) {
      corners_m.forEach(([x_m, y_m], k) => {
        const [from_x_m, from_y_m] = corners_m.at(k - 1)!;
        this.#ground.line(toScene(from_x_m, from_y_m, 0), toScene(x_m, y_m, 0), { ...low, alpha: 0.8 });
      });
    }
  }

  /** The way of the formation's centre, with arrows the way it goes; and a thread from the target up to it. */
  #orbit({ orbit, formation }: Status, x_m: number, y_m: number, palette: Palette): void {
    const up = toScene(x_m, y_m, formation.height_m);
    this.#lines.line(toScene(x_m, y_m, 0), up, { color: palette.target, alpha: 0.5, width_px: 1.2, dash_m: 1.5 });
    if (!(orbit.radius_m > 0)) {
      return;
    }
    const style: Style = { color: palette.orbit, alpha: 0.75, width_px: 1.6, dash_m: 2 };
    this.#lines.circle(up, orbit.radius_m, style);
    const sense = orbit.direction === "clockwise" ? 1 : -1; // seen from above
    const head_m = Math.min(2.5, 0.12 * orbit.radius_m);
    for (let k = 0; k < ARROWS; k += 1) {
      const turn = (2 * Math.PI * (k + 0.5)) / ARROWS;
      const at = (off: number, radius_m: number): Vec3 => [
        up[0] + radius_m * Math.sin(turn + off), up[1], up[2] - radius_m * Math.cos(turn + off),
      ];
      const tip = at(0, orbit.radius_m);
      const back = (-sense * head_m) / orbit.radius_m;
      for (const side of [-0.5, 0.5]) {
        this.#lines.line(tip, at(back, orbit.radius_m + side * head_m), { ...style, dash_m: 0, width_px: 2 });
      }
    }
  }

  #obstacle(box: Obstacle, palette: Palette): void {
    const [low, high] = cornersOf(box);
    const middle: Vec3 = [box.y_m, box.height_m / 2, -box.x_m];
    this.#boxes.put(middle, [box.half_length_y_m, box.height_m / 2, box.half_length_x_m], palette.obstacle, palette.night ? 0.14 : 0.3);
    this.#lines.box(low, high, { color: palette.obstacle, alpha: palette.night ? 0.5 : 0.8, width_px: 1.2 });
  }

  /** Its label. */
  words(status: Status, frame: Frame, time_s: number, eye: Eye, overlay: Overlay): void {
    const [x_m, y_m] = frame.target_m;
    overlay.put(eye, toScene(x_m, y_m, 0), texts.scene.target, "thing", 26);
    for (const box of status.obstacles) {
      const { id, height_m, ...at } = broughtForward(box, time_s - status.time_s);
      overlay.put(eye, toScene(at.x_m, at.y_m, height_m), texts.scene.obstacle(id, height_m.toFixed(1)), "thing", -14);
    }
    if (this.#fenceNearness === 0 && eye.pose.elevation < SEEN_FROM_ABOVE) {
      return;
    }
    const { distance_max_m, height_max_m } = status.flight_envelope;
    const [s, c] = [Math.sin(eye.pose.azimuth), Math.cos(eye.pose.azimuth)];
    overlay.put(eye, [distance_max_m * s, 0, -distance_max_m * c], texts.scene.fence(distance_max_m), "grid", 12);
    overlay.put(eye, [distance_max_m * s, height_max_m, -distance_max_m * c], texts.scene.ceiling(height_max_m), "grid", -12);
  }

  dispose(): void {
    for (const each of [this.#decals, this.#ground, this.#lines, this.#boxes]) {
      each.dispose();
    }
  }
}
