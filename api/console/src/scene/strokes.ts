// Every line of the scene that is not a trail: one draw call for as many as one likes, in pixels' width, soft, dashed
// or not. Collected again after a change.

import type { Vec3 } from "./axes";
import type { Shared } from "./camera";
import { STRIP, STRIP_EDGE } from "./glsl";
import { Collected, stripShape, telling } from "./instances";
import type { Rgb } from "./palette";

export interface Style {
  color: Rgb;
  alpha: number;
  width_px: number;
  /** Of a dash and its gap; 0: no dashes. */
  dash_m?: number;
}

const TURN = 2 * Math.PI;

export class Strokes extends Collected {
  /** Rounded: lines on a unit sphere around the mesh's own place, fainter behind it. */
  constructor(shared: Shared, order: number, { hidden = true, rounded = false } = {}) {
    const uniforms = { ...shared, uRounded: { value: rounded ? 1 : 0 } };
    super(stripShape(), 4, { uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, hidden }, order);
  }

  line(start: Vec3, end: Vec3, { color, alpha, width_px, dash_m = 0 }: Style, along_m = 0): void {
    const length_m = Math.hypot(end[0] - start[0], end[1] - start[1], end[2] - start[2]);
    this.add(...start, 0, ...end, 0, ...color, alpha, width_px, dash_m, along_m, along_m + length_m);
  }

  /** A level circle, or one in the plane of two directions of length 1. */
  circle(center: Vec3, radius_m: number, style: Style, across: Vec3 = [1, 0, 0], up: Vec3 = [0, 0, 1], parts = 96): void {
    const whole_m = TURN * radius_m;
    const dashes = style.dash_m ? Math.max(1, Math.round(whole_m / style.dash_m)) : 0;
    const even: Style = { ...style, dash_m: dashes > 0 ? whole_m / dashes : 0 }; // the last dash meets the first
    const at = (k: number): Vec3 => {
      const [c, s] = [radius_m * Math.cos((TURN * k) / parts), radius_m * Math.sin((TURN * k) / parts)];
      return [
        center[0] + c * across[0] + s * up[0], center[1] + c * across[1] + s * up[1], center[2] + c * across[2] + s * up[2],
      ];
    };
    for (let k = 0; k < parts; k += 1) {
      this.line(at(k), at(k + 1), even, (whole_m * k) / parts);
    }
  }

  box(low: Vec3, high: Vec3, style: Style): void {
    const corner = (k: number): Vec3 => [k & 1 ? high[0] : low[0], k & 2 ? high[1] : low[1], k & 4 ? high[2] : low[2]];
    for (const [a, b] of EDGES) {
      this.line(corner(a), corner(b), style);
    }
  }

  /** An arrow; its head is a share of its length. */
  arrow(start: Vec3, end: Vec3, style: Style, side: Vec3): void {
    this.line(start, end, style);
    const back: Vec3 = [start[0] - end[0], start[1] - end[1], start[2] - end[2]];
    const length_m = Math.hypot(...back);
    for (const turn of [-0.12, 0.12]) {
      this.line(end, [
        end[0] + 0.25 * back[0] + turn * length_m * side[0],
        end[1] + 0.25 * back[1] + turn * length_m * side[1],
        end[2] + 0.25 * back[2] + turn * length_m * side[2],
      ], style);
    }
  }
}

const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]] as const;

const VERTEX = /* glsl */ `
uniform float uRounded;
varying vec4 vColor;
varying vec2 vDash;
${telling(4)}
${STRIP}
void main() {
  vec4 style = reported(3);
  vec3 start = (modelMatrix * vec4(reported(0).xyz, 1.0)).xyz;
  vec3 end = (modelMatrix * vec4(reported(1).xyz, 1.0)).xyz;
  gl_Position = strip(start, end, position.xy, style.x);
  vec3 own = modelMatrix[3].xyz;
  float facing = dot(normalize((position.x < 0.5 ? start : end) - own + 1e-6), normalize(cameraPosition - own));
  vColor = reported(2);
  vColor.a *= mix(1.0, mix(0.22, 1.0, smoothstep(-0.15, 0.45, facing)), uRounded);
  vDash = vec2(mix(style.z, style.w, position.x), style.y);
}`;

const FRAGMENT = /* glsl */ `
varying vec4 vColor;
varying vec2 vDash;
${STRIP_EDGE}
void main() {
  float alpha = vColor.a * edge();
  if (vDash.y > 0.0) {
    float off = abs(fract(vDash.x / vDash.y) - 0.5) * vDash.y; // from the middle of a gap
    alpha *= smoothstep(0.18, 0.24, off / vDash.y);
  }
  gl_FragColor = vec4(vColor.rgb * alpha, alpha);
}`;
