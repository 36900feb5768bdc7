// The vehicles: little quadrotors, all in one draw call, never smaller than one can see.

import { Vector3, type BufferGeometry } from "three";

import { color, type Shared } from "./camera";
import { Repeated, telling, type Table } from "./instances";
import { ORDER } from "./materials";
import type { Palette } from "./palette";
import { quadrotor } from "./quadrotor";
import type { Screen } from "./screen";

/** Attributes of every vehicle in every frame: position and turn; colour and shine; marks and form. */
export const REPORTED = 3;

/** Half of the span that is drawn at least: somewhat more than theirs, and what one still sees from far away. */
export const HALF_SPAN_M = 0.45;
const FINE_UP_TO = 40; // vehicles; the more there are, the simpler
const MEDIUM_UP_TO = 120;

/** In a small picture they are smaller: their lights would be one. */
const SMALL_SIDE_PX = 640;

export function least_px(n: number, { width, height }: Screen["free"]): number {
  const share = Math.min(1, Math.max(0.5, Math.min(width, height) / SMALL_SIDE_PX));
  return Math.max(5.5, share * Math.min(19, 25 - 2.2 * Math.log2(Math.max(1, n))));
}

export class Vehicles {
  readonly #all: Repeated;
  readonly #uniforms;
  readonly #shapes = { fine: quadrotor(12), medium: quadrotor(6), simple: quadrotor(4) } as const;

  constructor(shared: Shared) {
    this.#uniforms = {
      ...shared, uHalf: { value: HALF_SPAN_M }, uLeast: { value: 15 },
      uStructure: { value: new Vector3() }, uNose: { value: new Vector3() },
    };
    this.#all = new Repeated({ uniforms: this.#uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, hides: true }, ORDER.vehicles);
  }

  get mesh(): Repeated["mesh"] {
    return this.#all.mesh;
  }

  draw(table: Table, n: number, free: Screen["free"]): void {
    this.#uniforms.uLeast.value = least_px(n, free);
    this.#all.draw(this.#shapeFor(n), table, n);
  }

  dress(palette: Palette): void {
    this.#uniforms.uStructure.value = color(palette.structure);
    this.#uniforms.uNose.value = color(palette.nose);
  }

  #shapeFor(n: number): BufferGeometry {
    return n <= FINE_UP_TO ? this.#shapes.fine : n <= MEDIUM_UP_TO ? this.#shapes.medium : this.#shapes.simple;
  }

  dispose(): void {
    this.#all.dispose();
    Object.values(this.#shapes).forEach((each) => each.dispose());
  }
}

const VERTEX = /* glsl */ `
attribute float aPaint;
uniform float uHalf;
uniform float uLeast;
uniform float uPerPixel;
uniform float uNight;
uniform vec3 uStructure;
uniform vec3 uNose;
varying vec3 vColor;
${telling(REPORTED)}

/** A vehicle seen from its edge tilts towards the camera, since a flat thing seen from its edge has no shape. Heading stays. */
mat3 leaning(vec3 toEye) {
  float lean = clamp(0.5 - asin(clamp(toEye.y, -1.0, 1.0)), 0.0, 0.9);
  vec3 level = normalize(vec3(toEye.x, 1e-5, toEye.z));
  vec3 axis = vec3(level.z, 0.0, -level.x);
  float c = cos(lean);
  float s = sin(lean);
  float k = 1.0 - c;
  return mat3(
    c + axis.x * axis.x * k, axis.z * s, axis.x * axis.z * k,
    -axis.z * s, c, axis.x * s,
    axis.x * axis.z * k, -axis.x * s, c + axis.z * axis.z * k
  );
}
void main() {
  vec4 place = reported(0);
  vec4 tint = reported(1);
  if (!(place.x + place.y + place.z < 1e9)) { // unknown
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    return;
  }
  vec4 center = viewMatrix * vec4(place.xyz, 1.0);
  float size = max(uHalf, uLeast * uPerPixel * -center.z);
  float c = cos(place.w);
  float s = sin(place.w);
  mat3 turn = leaning(normalize(cameraPosition - place.xyz)) * mat3(c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c);
  gl_Position = projectionMatrix * viewMatrix * vec4(place.xyz + size * (turn * position), 1.0);
  float lit = 0.62 + 0.38 * dot(turn * normal, normalize(vec3(0.35, 0.85, 0.4)));
  vec3 painted = tint.rgb * mix(lit, 1.0, 0.55 * uNight * tint.a);
  vec3 nose = mix(tint.rgb, uNose, 0.3 + 0.7 * tint.a) * mix(0.8, 1.0, lit);
  vColor = aPaint < 0.5 ? uStructure * lit * 1.15 : aPaint < 1.5 ? painted : nose;
}`;

const FRAGMENT = /* glsl */ `
varying vec3 vColor;
void main() {
  gl_FragColor = vec4(vColor, 1.0);
}`;
