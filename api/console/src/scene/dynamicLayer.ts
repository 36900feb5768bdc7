// What changes with every picture: threads to the ground, pairs that are close, what the selected one is told to fly,
// and the ghost of what is being dragged.

import type { Group } from "three";

import { editedBox } from "../obstacle";
import type { Frame, Obstacle, Preview, State } from "../state";
import { texts } from "../texts";
import { toScene, type Vec3 } from "./axes";
import { CLOSE, type Floor, type Pair } from "./proximity";
import { DECAL, Decals } from "./decals";
import type { Eye, Shared } from "./camera";
import { boxHandles, cornersOf, handleOf } from "./dragPreviews";
import { ORDER } from "./materials";
import type { Overlay } from "./overlay";
import type { Palette, Rgb } from "./palette";
import { placeOf, type Poses } from "./playback";
import { Solids } from "./solids";
import { Strokes, type Style } from "./strokes";

const THREADS_UP_TO = 60; // vehicles
const WRITTEN_PAIRS = 6;
const AHEAD_S = 1.5; // length of the arrow of a setpoint
const SPOT_PX = 7;

/** All that a picture is made of. */
export interface Picture {
  state: State;
  frame: Frame;
  poses: Poses;
  pairs: readonly Pair[];
  floor: Floor;
  tints: Float32Array;
  selected: number;
  palette: Palette;
  eye: Eye;
}

export class DynamicLayer {
  readonly #spots: Decals;
  readonly #lines: Strokes;
  readonly #bubbles: Solids;
  readonly #previewBox: Solids;
  readonly #previewLines: Strokes;

  constructor(shared: Shared, into: Group) {
    this.#spots = new Decals(shared);
    this.#lines = new Strokes(shared, ORDER.strokes);
    this.#bubbles = new Solids(shared, ORDER.bubbles, "ellipsoid");
    this.#previewBox = new Solids(shared, ORDER.bubbles, "box");
    this.#previewLines = new Strokes(shared, ORDER.marks, { hidden: false });
    into.add(this.#spots.mesh, this.#lines.mesh, this.#bubbles.mesh, this.#previewBox.mesh, this.#previewLines.mesh);
  }

  draw(picture: Picture, overlay: Overlay): void {
    const parts = [this.#spots, this.#lines, this.#bubbles, this.#previewBox, this.#previewLines];
    parts.forEach((each) => each.clear());
    this.#threads(picture);
    this.#pairs(picture, overlay);
    this.#setpoint(picture);
    this.#preview(picture, overlay);
    parts.forEach((each) => each.commit());
  }

  /** Each vehicle's position on the ground, and its height above it. */
  #threads({ poses, tints, selected, palette }: Picture): void {
    const faint = poses.n <= THREADS_UP_TO ? 0.2 : 0;
    for (let i = 0; i < poses.n; i += 1) {
      const [x, y, z] = placeOf(poses, i);
      if (!poses.known(i)) {
        continue;
      }
      const color: Rgb = [tints[4 * i]!, tints[4 * i + 1]!, tints[4 * i + 2]!];
      const strength = palette.night ? 0.2 + 0.3 * tints[4 * i + 3]! : 0.35;
      this.#spots.put([x, 0, z], palette.night ? color : palette.structure, strength, -SPOT_PX, DECAL.spot);
      const alpha = i === selected ? 0.75 : faint;
      if (alpha > 0 && y > 0.5) {
        this.#lines.line([x, 0, z], [x, y, z], { color, alpha, width_px: 1 });
      }
    }
  }

  /** Half of the floor's ellipsoid around each: two that touch are as close as two may be. */
  #pairs({ poses, pairs, floor, palette, eye }: Picture, overlay: Overlay): void {
    const worst = new Map<number, number>();
    pairs.forEach(({ first, second, distance_m, proximity }, k) => {
      const color = colorOf(proximity, palette);
      const [a, b] = [placeOf(poses, first), placeOf(poses, second)];
      this.#lines.line(a, b, { color, alpha: 0.95, width_px: proximity < 1 ? 2.6 : 1.6 });
      if (k < WRITTEN_PAIRS) {
        const middle: Vec3 = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2];
        overlay.put(eye, middle, texts.scene.apart(distance_m.toFixed(1)), "close", -12);
      }
      for (const i of [first, second]) {
        worst.set(i, Math.min(proximity, worst.get(i) ?? CLOSE));
      }
    });
    const half: Vec3 = [floor.horizontal_m / 2, floor.vertical_m / 2, floor.horizontal_m / 2];
    for (const [i, proximity] of worst) {
      this.#bubbles.put(placeOf(poses, i), half, colorOf(proximity, palette), proximity < 1 ? 0.6 : 0.42);
    }
  }

  #setpoint({ frame, poses, selected, palette, eye }: Picture): void {
    const [vx, vy, vup] = [frame.setpoint_x_m_s[selected], frame.setpoint_y_m_s[selected], frame.setpoint_up_m_s[selected]];
    if (vx === undefined || vy === undefined || vup === undefined || !(Math.hypot(vx, vy, vup) > 0.1) || !poses.known(selected)) {
      return;
    }
    const start = placeOf(poses, selected);
    const way = toScene(vx * AHEAD_S, vy * AHEAD_S, vup * AHEAD_S);
    const end: Vec3 = [start[0] + way[0], start[1] + way[1], start[2] + way[2]];
    this.#previewLines.arrow(start, end, { color: palette.setpoint, alpha: 0.95, width_px: 2.2 }, sideOf(way, eye));
  }

  #preview(picture: Picture, overlay: Overlay): void {
    const { preview } = picture.state;
    const box = editedBox(picture.state);
    if (box !== null) {
      this.#edited(box, picture, overlay);
    }
    switch (preview?.kind) {
      case "target":
        return this.#previewTarget(preview, picture, overlay);
      case "radius":
        return this.#previewRadius(preview.radius_m, picture, overlay);
    }
  }

  #previewTarget(preview: Preview & { kind: "target" }, { state, frame, palette, eye }: Picture, overlay: Overlay): void {
    const { formation, orbit } = state.status!;
    const style = dashed(palette, eye);
    const [from, to] = [toScene(...frame.target_m, 0), toScene(preview.x_m, preview.y_m, 0)];
    const moved_m = Math.hypot(to[0] - from[0], to[2] - from[2]);
    this.#spots.put(to, palette.preview, 1, Math.max(1.4, 15 * eye.pixelAt_m(to)), DECAL.target);
    this.#previewLines.line(from, to, style);
    const up = toScene(preview.x_m, preview.y_m, formation.height_m);
    this.#previewLines.line(to, up, { ...style, alpha: 0.5 });
    this.#previewLines.circle(up, orbit.radius_m > 0 ? orbit.radius_m : frame.radius_m, { ...style, alpha: 0.6 });
    overlay.put(eye, to, texts.scene.previewPlace(preview.x_m.toFixed(1), preview.y_m.toFixed(1), moved_m.toFixed(1)), "preview", 34);
  }

  #previewRadius(radius_m: number, { frame, poses, palette, eye }: Picture, overlay: Overlay): void {
    if (poses.center === null) {
      return;
    }
    const style = dashed(palette, eye);
    this.#previewLines.circle(poses.center, radius_m, style);
    this.#previewLines.circle(poses.center, radius_m, style, eye.basis.right, eye.basis.up);
    const text = texts.scene.previewRadius(frame.radius_m.toFixed(1), radius_m.toFixed(1));
    overlay.put(eye, handleOf(poses.center, radius_m, eye.basis), text, "handle-preview");
  }

  /** Of an obstacle that is edited, with its handles. */
  #edited(box: Obstacle, { state, palette, eye }: Picture, overlay: Overlay): void {
    const style = dashed(palette, eye);
    const [low, corner] = cornersOf(box);
    const high = toScene(box.x_m, box.y_m, box.height_m);
    this.#previewBox.put([box.y_m, box.height_m / 2, -box.x_m], [box.half_length_y_m, box.height_m / 2, box.half_length_x_m], palette.preview, 0.16);
    this.#previewLines.box(low, corner, style);
    const at = [box.x_m.toFixed(1), box.y_m.toFixed(1)] as const;
    const real = state.status?.obstacles.find((each) => each.id === box.id);
    const moved_m = real === undefined ? null : Math.hypot(box.x_m - real.x_m, box.y_m - real.y_m);
    if (real !== undefined) {
      this.#previewLines.line(toScene(real.x_m, real.y_m, 0), toScene(box.x_m, box.y_m, 0), style);
    }
    overlay.put(eye, high, moved_m === null ? texts.scene.at(...at) : texts.scene.previewPlace(...at, moved_m.toFixed(1)), "preview", -24);
    for (const { part, place } of boxHandles(box, eye)) {
      const length_m = part.kind !== "side" ? box.height_m : 2 * (part.side[0] !== 0 ? box.half_length_x_m : box.half_length_y_m);
      const isNamed = part.kind !== "side" || part.side[0] + part.side[1] > 0;
      overlay.put(eye, place, isNamed ? texts.scene[part.kind === "side" ? "side" : "high"](length_m.toFixed(1)) : "", "handle-preview");
    }
  }

  dispose(): void {
    for (const each of [this.#spots, this.#lines, this.#bubbles, this.#previewBox, this.#previewLines]) {
      each.dispose();
    }
  }
}

function dashed(palette: Palette, eye: Eye): Style {
  return { color: palette.preview, alpha: 0.95, width_px: 1.8, dash_m: 0.016 * eye.pose.span_m };
}

/** The arrow's head lies across the line of sight, so that one sees it. */
function sideOf(way: Vec3, { basis }: Eye): Vec3 {
  const [a, b] = [way, basis.forward];
  const side: Vec3 = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const length = Math.hypot(...side) || 1;
  return [side[0] / length, side[1] / length, side[2] / length];
}

function colorOf(proximity: number, { caution, danger }: Palette): Rgb {
  return proximity < 1 ? danger : caution;
}
