// Lines on the ground around where the camera looks, and their metres. How far apart follows the zoom.

import { BufferAttribute, BufferGeometry, Mesh, Vector2, Vector3, type ShaderMaterial } from "three";

import { texts } from "../texts";
import { roundStep } from "./axes";
import { color, type Eye, type Shared } from "./camera";
import { STRIP, STRIP_EDGE } from "./glsl";
import { material, ORDER } from "./materials";
import type { Overlay } from "./overlay";
import type { Palette } from "./palette";

const NUMBERS_PX = 115; // between two numbers, at least
const NUMBERS = 5; // to each side
const LINES = 40; // to each side
const PARTS = 10; // of a line: it fades along them

/** Metres between numbers, and into how many parts the finer lines divide that. */
export function stepsFor(span_m: number, height_px: number): { step_m: number; parts: number } {
  const step_m = roundStep((NUMBERS_PX * span_m) / height_px);
  const first = step_m / 10 ** Math.floor(Math.log10(step_m) + 1e-9);
  return { step_m, parts: Math.round(first) === 2 ? 4 : 5 };
}

export class Grid {
  readonly mesh: Mesh<BufferGeometry, ShaderMaterial>;
  readonly #uniforms;

  constructor(shared: Shared) {
    this.#uniforms = {
      ...shared, uOrigin: { value: new Vector2() }, uFocus: { value: new Vector2() }, uLines: { value: new Vector2(1, 5) },
      uColor: { value: new Vector3() }, uStrength: { value: 0.5 },
    };
    const recipe = { uniforms: this.#uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, hidden: false };
    this.mesh = new Mesh(shapeOfLines(), material(recipe));
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = ORDER.grid;
  }

  draw(eye: Eye, overlay: Overlay): void {
    const { focus, span_m } = eye.pose;
    const { step_m, parts } = stepsFor(span_m, eye.screen.free.height);
    this.#uniforms.uLines.value.set(step_m / parts, parts);
    this.#uniforms.uOrigin.value.set(step_m * Math.round(focus[0] / step_m), step_m * Math.round(focus[2] / step_m));
    this.#uniforms.uFocus.value.set(focus[0], focus[2]);
    writeNumbers(eye, overlay, step_m);
  }

  dress(palette: Palette): void {
    this.#uniforms.uColor.value = color(palette.line);
    this.#uniforms.uStrength.value = palette.night ? 0.36 : 0.5;
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}

/** Along the lines of the ground that go through the origin, or, where that is far off, nearer ones. */
function writeNumbers(eye: Eye, overlay: Overlay, step_m: number): void {
  const { focus } = eye.pose;
  const near = (value: number): number => (Math.abs(value) < NUMBERS * step_m ? 0 : Math.round(value / step_m));
  const [column, row] = [near(focus[0]), near(focus[2])]; // of the lines that are written on, in steps
  const [x, z] = [Math.round(focus[0] / step_m), Math.round(focus[2] / step_m)];
  const inMetres = (steps: number): number => Number((steps * step_m).toPrecision(9)) + 0;
  for (let k = -NUMBERS; k <= NUMBERS; k += 1) {
    if (z + k !== 0) {
      overlay.put(eye, [column * step_m, 0, (z + k) * step_m], texts.scene.gridX(inMetres(-z - k)), "grid");
    }
    if (x + k !== 0) {
      overlay.put(eye, [(x + k) * step_m, 0, row * step_m], texts.scene.gridY(inMetres(x + k)), "grid");
    }
  }
}

/** Every line in parts; aLine: 0 or 1 for its way, its number from the middle, where the part begins and ends, -1 to 1. */
function shapeOfLines(): BufferGeometry {
  const corners: number[] = [];
  const lines: number[] = [];
  const index: number[] = [];
  for (const way of [0, 1]) {
    for (let k = -LINES; k <= LINES; k += 1) {
      for (let part = 0; part < PARTS; part += 1) {
        const first = corners.length / 3;
        corners.push(0, -1, 0, 1, -1, 0, 0, 1, 0, 1, 1, 0);
        for (let corner = 0; corner < 4; corner += 1) {
          lines.push(way, k, (2 * part) / PARTS - 1, (2 * part + 2) / PARTS - 1);
        }
        index.push(first, first + 1, first + 2, first + 2, first + 1, first + 3);
      }
    }
  }
  const shape = new BufferGeometry();
  shape.setAttribute("position", new BufferAttribute(new Float32Array(corners), 3));
  shape.setAttribute("aLine", new BufferAttribute(new Float32Array(lines), 4));
  shape.setIndex(index);
  return shape;
}

const VERTEX = /* glsl */ `
attribute vec4 aLine;
uniform vec2 uOrigin; // a crossing of two lines with numbers, near the focus
uniform vec2 uFocus;
uniform vec2 uLines; // metres between lines, and how many to a number
uniform float uStrength;
varying float vAlpha;
${STRIP}
void main() {
  float reach = ${LINES}.0 * uLines.x;
  float off = aLine.y * uLines.x;
  vec2 a = aLine.x < 0.5 ? vec2(off, aLine.z * reach) : vec2(aLine.z * reach, off);
  vec2 b = aLine.x < 0.5 ? vec2(off, aLine.w * reach) : vec2(aLine.w * reach, off);
  float at = off + (aLine.x < 0.5 ? uOrigin.x : uOrigin.y);
  float isAxis = abs(at) < 0.01 * uLines.x ? 1.0 : 0.0;
  float isWhole = abs(mod(aLine.y + 0.5, uLines.y) - 0.5) < 0.1 ? 1.0 : 0.0;
  vec2 here = (position.x < 0.5 ? a : b) + uOrigin;
  float far = length(here - uFocus) / reach;
  vAlpha = uStrength * mix(mix(0.26, 0.72, isWhole), 1.5, isAxis) * (1.0 - smoothstep(0.25, 0.98, far));
  gl_Position = strip(vec3(a + uOrigin, 0.0).xzy, vec3(b + uOrigin, 0.0).xzy, position.xy, mix(0.9, 1.5, isAxis));
  if (vAlpha < 0.004 && max(abs(aLine.z), abs(aLine.w)) > 0.9) gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
}`;

const FRAGMENT = /* glsl */ `
uniform vec3 uColor;
varying float vAlpha;
${STRIP_EDGE}
void main() {
  float alpha = vAlpha * edge();
  gl_FragColor = vec4(uColor * alpha, alpha);
}`;
