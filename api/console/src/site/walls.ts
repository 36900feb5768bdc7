/** Upright walls that one can see through, from one height to another. */

import type { Shared } from "../scene/camera";
import type { Vec3 } from "../scene/axes";
import { Collected, stripShape, telling } from "../scene/instances";
import type { Rgb } from "../scene/palette";

export class Walls extends Collected {
  constructor(shared: Shared, order: number) {
    super(stripShape(), 3, { uniforms: { ...shared }, vertexShader: VERTEX, fragmentShader: FRAGMENT }, order);
  }

  /** Upwards of a line on the ground; `alpha` at its foot, less above. */
  put(start: Vec3, end: Vec3, low_m: number, high_m: number, color: Rgb, alpha: number): void {
    this.add(...start, low_m, ...end, high_m, ...color, alpha);
  }
}

const VERTEX = /* glsl */ `
varying vec4 vColor;
varying float vUp;
${telling(3)}
void main() {
  vec4 start = reported(0);
  vec4 end = reported(1);
  vUp = 0.5 + 0.5 * position.y;
  vec3 at = mix(start.xyz, end.xyz, position.x);
  at.y = mix(start.w, end.w, vUp);
  vColor = reported(2);
  gl_Position = projectionMatrix * viewMatrix * vec4(at, 1.0);
}`;

const FRAGMENT = /* glsl */ `
varying vec4 vColor;
varying float vUp;
void main() {
  float alpha = vColor.a * mix(1.0, 0.45, vUp);
  gl_FragColor = vec4(vColor.rgb * alpha, alpha);
}`;
