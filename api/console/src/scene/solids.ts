// Solids one can see through: obstacles, and the room that two close vehicles have to leave each other.

import { BoxGeometry, FrontSide, SphereGeometry } from "three";

import type { Vec3 } from "./axes";
import type { Shared } from "./camera";
import { Collected, telling } from "./instances";
import type { Rgb } from "./palette";

export class Solids extends Collected {
  constructor(shared: Shared, order: number, form: "box" | "ellipsoid") {
    const shape = form === "box" ? new BoxGeometry(2, 2, 2) : new SphereGeometry(1, 20, 12);
    const uniforms = { ...shared, uRim: { value: form === "box" ? 0 : 1 } };
    super(shape, 3, { uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT }, order);
    this.mesh.material.side = FrontSide;
  }

  put(middle: Vec3, half: Vec3, color: Rgb, alpha: number): void {
    this.add(...middle, 0, ...half, 0, ...color, alpha);
  }
}

const VERTEX = /* glsl */ `
varying vec4 vColor;
varying vec3 vNormal;
varying vec3 vToEye;
${telling(3)}
void main() {
  vec3 halves = reported(1).xyz;
  vec3 at = reported(0).xyz + halves * position;
  vColor = reported(2);
  vNormal = normalize(normal / halves);
  vToEye = cameraPosition - at;
  gl_Position = projectionMatrix * viewMatrix * vec4(at, 1.0);
}`;

const FRAGMENT = /* glsl */ `
uniform float uRim;
varying vec4 vColor;
varying vec3 vNormal;
varying vec3 vToEye;
void main() {
  vec3 normal = normalize(vNormal);
  float rim = 1.0 - abs(dot(normal, normalize(vToEye)));
  float lit = 0.6 + 0.4 * dot(normal, normalize(vec3(0.35, 0.85, 0.4)));
  float alpha = vColor.a * mix(1.0, 0.18 + 0.82 * rim * rim, uRim);
  gl_FragColor = vec4(vColor.rgb * mix(lit, 1.0, uRim) * alpha, alpha);
}`;
