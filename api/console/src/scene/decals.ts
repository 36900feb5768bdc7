// What lies flat on the ground: pads, and below each vehicle the spot over which it flies. One draw call each.

import type { Vec3 } from "./axes";
import type { Shared } from "./camera";
import { Collected, stripShape, telling } from "./instances";
import { ORDER } from "./materials";
import type { Rgb } from "./palette";

export const DECAL = { pad: 0, spot: 1, target: 2 } as const;

export class Decals extends Collected {
  constructor(shared: Shared) {
    const recipe = { uniforms: { ...shared }, vertexShader: VERTEX, fragmentShader: FRAGMENT, hidden: false };
    super(stripShape(), 3, recipe, ORDER.decals);
  }

  /** Radius in metres; a negative one in pixels. */
  put(place: Vec3, color: Rgb, alpha: number, radius: number, kind: number): void {
    this.add(...place, 0, ...color, alpha, radius, kind);
  }
}

const VERTEX = /* glsl */ `
uniform float uPerPixel;
varying vec2 vAt;
varying vec4 vColor;
varying float vKind;
varying float vPixel;
${telling(3)}
void main() {
  vec3 place = reported(0).xyz;
  vec2 kind = reported(2).xy;
  float away = -(viewMatrix * vec4(place, 1.0)).z;
  float pixel = uPerPixel * max(away, 0.1);
  float radius = kind.x < 0.0 ? -kind.x * pixel : max(kind.x, 5.0 * pixel);
  vAt = vec2(position.x * 2.0 - 1.0, position.y);
  vColor = reported(1);
  vKind = kind.y;
  vPixel = pixel / radius;
  gl_Position = projectionMatrix * viewMatrix * vec4(place + radius * vec3(vAt.x, 0.0, vAt.y), 1.0);
}`;

const FRAGMENT = /* glsl */ `
uniform float uNight;
varying vec2 vAt;
varying vec4 vColor;
varying float vKind;
varying float vPixel;

float ring(float far, float radius, float wide) {
  float soft = max(fwidth(far), vPixel);
  return clamp((0.5 * wide - abs(far - radius)) / soft + 0.5, 0.0, 1.0);
}

void main() {
  float far = length(vAt);
  float on;
  if (vKind < 0.5) { // pad: a ring with an H
    vec2 off = abs(vAt);
    float soft = max(fwidth(vAt.x), fwidth(vAt.y));
    float posts = clamp((0.09 - abs(off.x - 0.28)) / soft + 0.5, 0.0, 1.0) * step(off.y, 0.42);
    float bar = clamp((0.08 - off.y) / soft + 0.5, 0.0, 1.0) * step(off.x, 0.28);
    on = max(ring(far, 0.85, max(0.14, 1.4 * vPixel)), max(posts, bar) * clamp(0.3 / vPixel - 1.2, 0.0, 1.0));
  } else if (vKind < 1.5) { // spot
    float fall = max(0.0, 1.0 - far);
    on = fall * fall;
  } else { // target: two rings and a cross
    vec2 off = abs(vAt);
    float soft = max(fwidth(vAt.x), fwidth(vAt.y));
    float thin = min(off.x, off.y);
    float cross = clamp((0.035 - thin) / soft + 0.5, 0.0, 1.0) * step(max(off.x, off.y), 0.97) * step(0.16, max(off.x, off.y));
    on = max(max(ring(far, 0.78, 0.09), ring(far, 0.4, 0.08)), max(cross, clamp((0.1 - far) / soft + 0.5, 0.0, 1.0)));
  }
  float alpha = on * vColor.a;
  gl_FragColor = vec4(vColor.rgb * alpha, vKind > 0.5 && vKind < 1.5 ? alpha * mix(1.0, 0.0, uNight) : alpha);
}`;
