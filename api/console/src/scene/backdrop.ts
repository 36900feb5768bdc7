// Sky, haze and ground: a few bands of colour from the top of the screen to its bottom. The horizon is always level.

import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, NoBlending, ShaderMaterial } from "three";

import type { Eye } from "./camera";
import { ORDER } from "./materials";
import type { Palette, Rgb } from "./palette";
import { middleOf } from "./picking";

const BANDS = 24;
const SKY_RAD = 0.45; // from here on up the sky is the same

export class Backdrop {
  readonly mesh: Mesh<BufferGeometry, ShaderMaterial>;
  readonly #position = new BufferAttribute(new Float32Array(2 * 3 * (BANDS + 1)), 3);
  readonly #color = new BufferAttribute(new Float32Array(2 * 3 * (BANDS + 1)), 3);

  constructor() {
    const bands = new BufferGeometry();
    bands.setAttribute("position", this.#position);
    bands.setAttribute("aColor", this.#color);
    bands.setIndex(Array.from({ length: BANDS }, (_, k) => [0, 1, 2, 2, 1, 3].map((corner) => 2 * k + corner)).flat());
    const shader = { vertexShader: VERTEX, fragmentShader: FRAGMENT };
    const flat = { blending: NoBlending, depthTest: false, depthWrite: false, side: DoubleSide } as const;
    this.mesh = new Mesh(bands, new ShaderMaterial({ ...shader, ...flat }));
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = ORDER.backdrop;
  }

  /** Fit it to the camera. */
  look({ basis, pose, screen, shared }: Eye, palette: Palette): void {
    const middle = middleOf(screen);
    const far_m = 2.2 * pose.span_m + 60;
    for (let k = 0; k <= BANDS; k += 1) {
      const py = (k / BANDS) * screen.height;
      const up = -pose.elevation + Math.atan((middle.py - py) * shared.uPerPixel.value); // above the horizon
      const color = up > 0 ? skyAt(up, palette) : groundAt(-up, basis.eye[1], far_m, palette);
      const y = 1 - (2 * py) / screen.height;
      this.#position.array.set([-1, y, 0, 1, y, 0], 6 * k);
      this.#color.array.set([...color, ...color], 6 * k);
    }
    this.#position.needsUpdate = true;
    this.#color.needsUpdate = true;
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}

function skyAt(up: number, { skyLow, skyTop }: Palette): Rgb {
  const share = Math.min(1, up / SKY_RAD);
  return mixed(skyLow, skyTop, share * share * (3 - 2 * share));
}

/** The farther the ground, the more haze. */
function groundAt(down: number, height_m: number, far_m: number, { haze, ground }: Palette): Rgb {
  return mixed(haze, ground, Math.exp((-0.5 * height_m) / Math.max(1e-4, Math.sin(down)) / far_m));
}

function mixed(a: Rgb, b: Rgb, share: number): Rgb {
  return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])];
}

const VERTEX = /* glsl */ `
attribute vec3 aColor;
varying vec3 vColor;
void main() {
  vColor = aColor;
  gl_Position = vec4(position.xy, 0.0, 1.0);
}`;

const FRAGMENT = /* glsl */ `
varying vec3 vColor;
void main() {
  gl_FragColor = vec4(vColor, 1.0);
}`;
