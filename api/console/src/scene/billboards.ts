// What always faces the screen around vehicles: the glow of lights, and marks. One draw call.

import { Vector3 } from "three";

import { color, type Shared } from "./camera";
import { Repeated, stripShape, telling, type Table } from "./instances";
import { ORDER } from "./materials";
import type { Palette } from "./palette";
import { HALF_SPAN_M, least_px, REPORTED } from "./vehicles";

export class Billboards {
  readonly #all: Repeated;
  readonly #uniforms;
  readonly #shape = stripShape();

  constructor(shared: Shared) {
    this.#uniforms = {
      ...shared, uHalf: { value: HALF_SPAN_M }, uLeast: { value: 15 }, uGlow: { value: 1 },
      uLimited: { value: new Vector3() }, uDanger: { value: new Vector3() }, uSelected: { value: new Vector3() },
    };
    this.#all = new Repeated({ uniforms: this.#uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, hidden: false }, ORDER.marks);
  }

  get mesh(): Repeated["mesh"] {
    return this.#all.mesh;
  }

  draw(table: Table, n: number): void {
    this.#uniforms.uLeast.value = least_px(n);
    this.#uniforms.uGlow.value = n > 300 ? 1.5 : n > 60 ? 1.9 : 2.9;
    this.#all.draw(this.#shape, table, n);
  }

  dress(palette: Palette): void {
    this.#uniforms.uLimited.value = color(palette.limited);
    this.#uniforms.uDanger.value = color(palette.danger);
    this.#uniforms.uSelected.value = color(palette.selected);
  }

  dispose(): void {
    this.#all.dispose();
    this.#shape.dispose();
  }
}

const VERTEX = /* glsl */ `
uniform float uHalf;
uniform float uLeast;
uniform float uGlow;
uniform float uPerPixel;
uniform float uNight;
varying vec2 vAt; // in half spans
varying vec4 vTint;
varying vec3 vMark;
varying float vPixel;
${telling(REPORTED)}
void main() {
  vec4 place = reported(0);
  vec4 tint = reported(1);
  float mark = reported(2).x;
  float shine = tint.a * mix(0.0, 1.0, uNight);
  vMark = vec3(mod(mark, 2.0), mod(floor(mark / 2.0), 2.0), mod(floor(mark / 4.0), 2.0));
  float reach = max(shine > 0.05 ? uGlow * mix(0.55, 1.0, shine) : 0.0, mark > 0.5 ? 2.3 : 0.0);
  if (reach == 0.0 || !(place.x + place.y + place.z < 1e9)) {
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    return;
  }
  vec4 center = viewMatrix * vec4(place.xyz, 1.0);
  float size = max(uHalf, uLeast * uPerPixel * -center.z);
  vPixel = uPerPixel * -center.z / size;
  vAt = vec2(position.x * 2.0 - 1.0, position.y) * reach;
  vTint = vec4(tint.rgb, shine);
  center.xy += vAt * size;
  gl_Position = projectionMatrix * center;
}`;

const FRAGMENT = /* glsl */ `
uniform float uGlow;
uniform vec3 uLimited;
uniform vec3 uDanger;
uniform vec3 uSelected;
varying vec2 vAt;
varying vec4 vTint;
varying vec3 vMark;
varying float vPixel;

float ring(float far, float radius, float wide_px) {
  return clamp(0.5 * wide_px + 0.5 - abs(far - radius) / vPixel, 0.0, 1.0);
}

void main() {
  float far = length(vAt);
  float fall = max(0.0, 1.0 - far / (uGlow * mix(0.55, 1.0, vTint.a)));
  float glow = vTint.a * fall * fall * (0.34 + 0.3 * fall * fall);
  vec4 sum = vec4(vTint.rgb * glow, 0.0);
  if (vMark.x + vMark.y + vMark.z < 0.5) {
    gl_FragColor = sum;
    return;
  }
  if (vMark.x > 0.5) { // limited: a broken ring
    float alpha = ring(far, 1.35, 1.8) * step(0.32, abs(fract(atan(vAt.y, vAt.x) * 1.2732395) - 0.5) * 2.0);
    sum = mix(sum, vec4(uLimited, 1.0), alpha);
  }
  if (vMark.y > 0.5) { // lost: a cross
    vec2 turned = abs(vec2(vAt.x + vAt.y, vAt.x - vAt.y)) * 0.7071;
    float alpha = clamp(1.5 - min(turned.x, turned.y) / vPixel, 0.0, 1.0) * step(0.9, far) * step(far, 1.7);
    sum = mix(sum, vec4(uDanger, 1.0), alpha);
  }
  if (vMark.z > 0.5) { // selected: four corners
    vec2 off = abs(vAt);
    float side = clamp(1.4 - abs(max(off.x, off.y) - 1.75) / vPixel, 0.0, 1.0) * step(1.05, min(off.x, off.y));
    sum = mix(sum, vec4(uSelected, 1.0), side);
  }
  gl_FragColor = sum;
}`;
