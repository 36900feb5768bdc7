// What always faces the screen around vehicles: the glow of lights, marks, and the form of each phase. One draw call.

import { Vector3 } from "three";

import { color, type Shared } from "./camera";
import { Repeated, stripShape, telling, type Table } from "./instances";
import { ORDER } from "./materials";
import type { Palette } from "./palette";
import type { Screen } from "./screen";
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

  draw(table: Table, n: number, free: Screen["free"]): void {
    this.#uniforms.uLeast.value = least_px(n, free);
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
varying vec3 vMark; // limited, selected, form
varying float vPixel;
${telling(REPORTED)}
void main() {
  vec4 place = reported(0);
  vec4 tint = reported(1);
  vec2 mark = reported(2).xy;
  float shine = tint.a * mix(0.0, 1.0, uNight);
  vMark = vec3(mod(mark.x, 2.0), floor(mark.x / 2.0), mark.y);
  float marked = mark.x > 0.5 ? 2.3 : mark.y > 2.5 ? 2.1 : mark.y > 0.5 ? 1.6 : 0.0; // no larger than it must be: every pixel counts
  float reach = max(shine > 0.05 ? uGlow * mix(0.55, 1.0, shine) : 0.0, marked);
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

/** How much of a line lies here, at so many half spans from its middle. */
float line(float off, float wide_px) {
  return clamp(0.5 * wide_px + 0.5 - off / vPixel, 0.0, 1.0);
}

/** Forms of phases, in the order of FORMS; each can be read without its colour. */
float formed(float form, vec2 at, float far) {
  vec2 off = abs(at);
  if (form < 1.5) { // standby: stands on a line
    return 0.7 * line(abs(at.y + 1.35), 1.2) * step(off.x, 1.0);
  }
  if (form < 2.5) { // offline: on a broken one
    return line(abs(at.y + 1.35), 1.2) * step(off.x, 1.0) * step(0.35, off.x);
  }
  if (form < 4.5) { // take-off: a roof over it; landing: a funnel under it
    float up = form < 3.5 ? at.y : -at.y;
    return line(abs(up - 2.0 + 0.75 * off.x) * 0.8, 2.0) * step(off.x, 1.15);
  }
  if (form < 5.5) { // hold: a bar on either side
    return line(abs(off.x - 1.55), 2.2) * step(off.y, 1.0);
  }
  if (form < 6.5) { // on its way home: a house
    float roof = line(abs(at.y - 2.0 + 0.75 * off.x) * 0.8, 1.8) * step(off.x, 1.5);
    float walls = line(abs(off.x - 1.45), 1.8) * step(-1.45, at.y) * step(at.y, 0.95);
    return max(max(roof, walls), line(abs(at.y + 1.45), 1.8) * step(off.x, 1.5));
  }
  float circle = ring(far, 1.6, 1.8);
  if (form < 7.5) { // pilot: a ring
    return circle;
  }
  vec2 turned = abs(vec2(at.x + at.y, at.x - at.y)) * 0.7071; // lost: a cross; killed: within a ring
  float cross = line(min(turned.x, turned.y), 2.0) * step(0.9, far) * step(far, 1.6);
  return form < 8.5 ? cross : max(cross, circle);
}

void main() {
  float far = length(vAt);
  float fall = max(0.0, 1.0 - far / (uGlow * mix(0.55, 1.0, vTint.a)));
  float glow = vTint.a * fall * fall * (0.34 + 0.3 * fall * fall);
  vec4 sum = vec4(vTint.rgb * glow, 0.0);
  if (vMark.x + vMark.y + vMark.z < 0.25) {
    gl_FragColor = sum;
    return;
  }
  if (vMark.x > 0.5) { // limited: a broken ring
    float alpha = ring(far, 1.35, 1.8) * step(0.32, abs(fract(atan(vAt.y, vAt.x) * 1.2732395) - 0.5) * 2.0);
    sum = mix(sum, vec4(uLimited, 1.0), alpha);
  }
  if (vMark.z > 0.5) {
    vec3 ink = vMark.z > 7.5 ? uDanger : mix(vTint.rgb, uSelected, 0.4);
    sum = mix(sum, vec4(ink, 1.0), formed(vMark.z, vAt, far));
  }
  if (vMark.y > 0.5) { // selected: four corners
    vec2 off = abs(vAt);
    float side = clamp(1.4 - abs(max(off.x, off.y) - 1.75) / vPixel, 0.0, 1.0) * step(1.05, min(off.x, off.y));
    sum = mix(sum, vec4(uSelected, 1.0), side);
  }
  gl_FragColor = sum;
}`;
