// The pads of a show that is being placed, beside the vehicles: drawn, taken hold of, moved and turned.

import type { Group } from "three";

import { beside } from "../placing/beside";
import { middleOf, OFF_M, padsOf, turnedTo, type Placing } from "../placing/model";
import type { Placement, State } from "../state";
import { may } from "../state";
import { texts } from "../texts";
import { toScene, toShow, type Vec3 } from "./axes";
import type { Eye, Shared } from "./camera";
import { DECAL, Decals } from "./decals";
import { rounded, step_m, type Sight } from "./dragPreviews";
import { ORDER } from "./materials";
import type { Overlay } from "./overlay";
import type { Palette } from "./palette";
import { onLevel, project, type Ray } from "./picking";
import { Strokes, type Style } from "./strokes";

const PAD_M = 0.9;
const MIDDLE_M = 1.1;
const REACH_PX = 22;
const BESIDE_M = 2.5; // the ring lies outside the pads
const WRITTEN = 8; // distances
const STEP_DEG = 0.5;

/** What of the pads is dragged: all of them, or the handle that turns them. */
export interface PadGrip {
  kind: "move" | "turn";
  begin: Placing;
  /** Show frame, where the pointer took hold. */
  hand: readonly [number, number];
}

/** The middle of the pads, and of the ring on which the handle is. */
function ringOf(placing: Placing): { middle: readonly [number, number]; radius_m: number } {
  const pads = padsOf(placing);
  const middle = middleOf(pads);
  return { middle, radius_m: BESIDE_M + Math.max(...pads.map(([x, y]) => Math.hypot(x - middle[0], y - middle[1]))) };
}

/** The handle: on the ring, where the drawing's x axis points. */
export function turnHandle(placing: Placing): Vec3 {
  const { middle, radius_m } = ringOf(placing);
  const turn = (placing.place.turn_deg * Math.PI) / 180;
  return toScene(middle[0] + radius_m * Math.cos(turn), middle[1] + radius_m * Math.sin(turn), 0);
}

/** What of the pads is under the pointer; null: nothing, or they may not be moved. */
export function padGripAt(state: State, sight: Sight, ray: Ray, px: number, py: number): PadGrip | null {
  const { placing } = state;
  if (placing === null || placing.busy !== "" || !may(state, "operate")) {
    return null;
  }
  const off_px = (place: Vec3): number => {
    const seen = project(sight.basis, sight.pose, sight.screen, place);
    return seen === null ? Infinity : Math.hypot(seen.px - px, seen.py - py);
  };
  const level = onLevel(ray, 0);
  if (level === null) {
    return null;
  }
  const { x_m, y_m } = toShow(level);
  const grip = (kind: PadGrip["kind"]): PadGrip => ({ kind, begin: placing, hand: [x_m, y_m] });
  if (off_px(turnHandle(placing)) <= REACH_PX) {
    return grip("turn");
  }
  const pads = padsOf(placing);
  const isNear = [middleOf(pads), ...pads].some(([x, y]) => Math.hypot(x - x_m, y - y_m) <= PAD_M || off_px(toScene(x, y, 0)) <= REACH_PX);
  return isNear ? grip("move") : null;
}

/** The placement after the pointer moved; as it was where the pointer is over nothing. */
export function padsMoved({ kind, begin, hand }: PadGrip, sight: Sight, ray: Ray): Placement {
  const level = onLevel(ray, 0);
  if (level === null) {
    return begin.place;
  }
  const { x_m, y_m } = toShow(level);
  if (kind === "move") {
    const step = step_m(sight.pose.span_m, sight.screen.free.height);
    const [by_x_m, by_y_m] = [rounded(x_m - hand[0], step), rounded(y_m - hand[1], step)];
    return { ...begin.place, x_m: rounded(begin.place.x_m + by_x_m, 0.01), y_m: rounded(begin.place.y_m + by_y_m, 0.01) };
  }
  const { middle } = ringOf(begin);
  const angle = (x: number, y: number): number => (Math.atan2(y - middle[1], x - middle[0]) * 180) / Math.PI;
  return turnedTo(begin, rounded(begin.place.turn_deg + angle(x_m, y_m) - angle(...hand), STEP_DEG));
}

export class PadsLayer {
  readonly #pads: Decals;
  readonly #lines: Strokes;

  constructor(shared: Shared, into: Group) {
    this.#pads = new Decals(shared);
    this.#lines = new Strokes(shared, ORDER.marks, { hidden: false });
    into.add(this.#pads.mesh, this.#lines.mesh);
  }

  draw(state: State, palette: Palette, eye: Eye, overlay: Overlay): void {
    this.#pads.clear();
    this.#lines.clear();
    if (state.placing !== null) {
      this.#show(state, state.placing, palette, eye, overlay);
    }
    this.#pads.commit();
    this.#lines.commit();
  }

  #show(state: State, placing: Placing, palette: Palette, eye: Eye, overlay: Overlay): void {
    const pads = padsOf(placing);
    for (const [x, y] of pads) {
      this.#pads.put(toScene(x, y, 0), palette.preview, 0.95, PAD_M, DECAL.pad);
    }
    const { middle, radius_m } = ringOf(placing);
    const [center, handle] = [toScene(...middle, 0), turnHandle(placing)];
    const style: Style = { color: palette.preview, alpha: 0.8, width_px: 1.6, dash_m: 0.016 * eye.pose.span_m };
    this.#pads.put(center, palette.preview, 1, MIDDLE_M, DECAL.target);
    overlay.put(eye, center, texts.placing.pads(placing.found.show), "thing", 26);
    this.#lines.circle(center, radius_m, style);
    this.#lines.arrow(center, handle, { ...style, dash_m: 0, width_px: 2 }, [(handle[2] - center[2]) / radius_m, 0, (center[0] - handle[0]) / radius_m]);
    overlay.put(eye, handle, texts.placing.handle(placing.place.turn_deg.toFixed(1)), "handle");
    const all = beside(state, placing).filter((each) => Number.isFinite(each.off_m));
    for (const at of all) {
      const isOff = at.off_m > OFF_M;
      const pad = pads[at.pad]!;
      this.#lines.line(toScene(at.x_m, at.y_m, 0), toScene(...pad, 0), { color: isOff ? palette.danger : palette.setpoint, alpha: 0.95, width_px: isOff ? 2.6 : 1.8 });
    }
    const farthest = all.filter((each) => each.off_m > OFF_M).sort((a, b) => b.off_m - a.off_m);
    for (const at of farthest.slice(0, WRITTEN)) {
      overlay.put(eye, toScene(at.x_m, at.y_m, 0), texts.placing.away(at.id, at.off_m.toFixed(1)), "close", 16);
    }
  }

  dispose(): void {
    this.#pads.dispose();
    this.#lines.dispose();
  }
}
