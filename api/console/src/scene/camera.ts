// The camera that three.js draws with, and its uniforms for every shader of the scene.

import { Camera, Vector2, Vector3 } from "three";

import { minus, type Vec3 } from "./axes";
import type { Palette, Rgb } from "./palette";
import { middleOf, perPixel, type Screen } from "./picking";
import { basisOf, distance_m, type Basis, type Pose } from "./rig";

/** Uniforms that all materials share; they are changed here only. */
export interface Shared {
  /** Canvas, CSS pixels. */
  uSize: { value: Vector2 };
  /** What one CSS pixel shows, for each metre ahead. */
  uPerPixel: { value: number };
  /** 1 at night: lights add up. 0 by day: they cover. */
  uNight: { value: number };
  [name: string]: { value: unknown };
}

/** What a vector uniform takes of a colour. */
export function color([red, green, blue]: Rgb): Vector3 {
  return new Vector3(red, green, blue);
}

export class Eye {
  readonly camera = new Camera();
  readonly shared: Shared = { uSize: { value: new Vector2(1, 1) }, uPerPixel: { value: 1 }, uNight: { value: 1 } };
  basis: Basis;
  pose: Pose;
  screen: Screen;

  constructor(pose: Pose, screen: Screen) {
    this.camera.matrixAutoUpdate = false;
    this.camera.matrixWorldAutoUpdate = false;
    this.pose = pose;
    this.screen = screen;
    this.basis = basisOf(pose);
    this.look(pose, screen);
  }

  look(pose: Pose, screen: Screen): void {
    this.pose = pose;
    this.screen = screen;
    this.basis = basisOf(pose);
    const { eye, right, up, forward } = this.basis;
    this.camera.matrixWorld.set(
      right[0], up[0], -forward[0], eye[0],
      right[1], up[1], -forward[1], eye[1],
      right[2], up[2], -forward[2], eye[2],
      0, 0, 0, 1,
    );
    this.camera.matrixWorldInverse.copy(this.camera.matrixWorld).invert();
    const away_m = distance_m(pose);
    const near_m = Math.max(0.05, 0.02 * away_m);
    const scale = near_m * perPixel(pose, screen);
    const middle = middleOf(screen);
    this.camera.projectionMatrix.makePerspective(
      -middle.px * scale, (screen.width - middle.px) * scale, middle.py * scale, (middle.py - screen.height) * scale,
      near_m, 3 * away_m + 4000,
    );
    this.camera.projectionMatrixInverse.copy(this.camera.projectionMatrix).invert();
    this.shared.uSize.value.set(screen.width, screen.height);
    this.shared.uPerPixel.value = perPixel(pose, screen);
  }

  /** What one CSS pixel shows there, in m. */
  pixelAt_m(place: Vec3): number {
    return Math.hypot(...minus(place, this.basis.eye)) * this.shared.uPerPixel.value;
  }

  dress(palette: Palette): void {
    this.shared.uNight.value = palette.night ? 1 : 0;
  }
}
