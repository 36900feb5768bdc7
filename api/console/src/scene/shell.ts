// The virtual sphere: a breath of light at its rim, and its circles of latitude and longitude.

import { BufferAttribute, BufferGeometry, Group, Mesh, Vector3, type ShaderMaterial } from "three";

import { dot, minus, type Vec3 } from "./axes";
import { color, type Eye, type Shared } from "./camera";
import { material, ORDER } from "./materials";
import type { Palette } from "./palette";
import { Strokes } from "./strokes";

const MERIDIANS = 6; // whole circles
const PARALLELS_DEG = [-60, -30, 0, 30, 60];
const ROUND = 96; // corners of the rim
const RINGS = [0, 0.5, 0.72, 0.86, 0.94, 1]; // of its radius

export class Shell {
  readonly group = new Group();
  readonly #lines: Strokes;
  readonly #rim: Mesh<BufferGeometry, ShaderMaterial>;
  readonly #uniforms;

  constructor(shared: Shared) {
    this.#uniforms = {
      ...shared, uColor: { value: new Vector3() }, uStrength: { value: 0.3 },
      uMiddle: { value: new Vector3() }, uAcross: { value: new Vector3() }, uUp: { value: new Vector3() },
    };
    const recipe = { uniforms: this.#uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, hidden: false };
    this.#rim = new Mesh(discOfRings(), material(recipe));
    this.#rim.frustumCulled = false;
    this.#rim.renderOrder = ORDER.shell;
    this.#lines = new Strokes(shared, ORDER.graticule, { hidden: false, rounded: true });
    this.group.add(this.#rim, this.#lines.mesh);
  }

  place(center: Vec3 | null, radius_m: number, { basis }: Eye): void {
    this.group.visible = center !== null && radius_m > 0;
    if (center === null) {
      return;
    }
    this.group.position.set(...center);
    this.group.scale.setScalar(radius_m);
    this.group.updateMatrixWorld(true);
    const way = minus(basis.eye, center);
    const away_m = Math.hypot(...way);
    const share = radius_m / away_m;
    this.#rim.visible = share < 0.98; // from within there is no rim
    if (!this.#rim.visible) {
      return;
    }
    // The rim that one sees is a circle, somewhat nearer than the middle and smaller than the radius.
    const out: Vec3 = [way[0] / away_m, way[1] / away_m, way[2] / away_m];
    const slant = dot(basis.right, out);
    const across = new Vector3(...basis.right).addScaledVector(new Vector3(...out), -slant).normalize();
    const up = new Vector3(...out).cross(across);
    const rim_m = radius_m * Math.sqrt(1 - share * share);
    this.#uniforms.uMiddle.value.set(...out).multiplyScalar(radius_m * share).add(this.group.position);
    this.#uniforms.uAcross.value.copy(across).multiplyScalar(rim_m);
    this.#uniforms.uUp.value.copy(up).multiplyScalar(rim_m);
  }

  dress(palette: Palette): void {
    this.#uniforms.uColor.value = color(palette.sphere);
    this.#uniforms.uStrength.value = palette.night ? 0.3 : 0.34;
    this.#lines.clear();
    const style = { color: palette.sphere, alpha: palette.night ? 0.32 : 0.5, width_px: 1 };
    for (let k = 0; k < MERIDIANS; k += 1) {
      const turn = (Math.PI * k) / MERIDIANS;
      this.#lines.circle([0, 0, 0], 1, style, [Math.sin(turn), 0, Math.cos(turn)], [0, 1, 0], 64);
    }
    for (const degrees of PARALLELS_DEG) {
      const latitude = (degrees * Math.PI) / 180;
      const equator = degrees === 0 ? { ...style, alpha: 1.5 * style.alpha, width_px: 1.4 } : style;
      this.#lines.circle([0, Math.sin(latitude), 0], Math.cos(latitude), equator, [1, 0, 0], [0, 0, 1], 64);
    }
    this.#lines.commit();
  }

  dispose(): void {
    this.#lines.dispose();
    this.#rim.geometry.dispose();
    this.#rim.material.dispose();
  }
}

/** Rings around each other; z says how near the rim a corner is. */
function discOfRings(): BufferGeometry {
  const position = RINGS.flatMap((ring) =>
    Array.from({ length: ROUND }, (_, k) => {
      const turn = (2 * Math.PI * k) / ROUND;
      return [ring * Math.cos(turn), ring * Math.sin(turn), ring];
    }).flat(),
  );
  const shape = new BufferGeometry();
  shape.setAttribute("position", new BufferAttribute(new Float32Array(position), 3));
  shape.setIndex(RINGS.slice(1).flatMap((_, ring) =>
    Array.from({ length: ROUND }, (_, k) => {
      const [a, b] = [ring * ROUND + k, ring * ROUND + ((k + 1) % ROUND)];
      return [a, a + ROUND, b, b, a + ROUND, b + ROUND];
    }).flat(),
  ));
  return shape;
}

const VERTEX = /* glsl */ `
uniform vec3 uMiddle;
uniform vec3 uAcross;
uniform vec3 uUp;
uniform vec3 uColor;
uniform float uStrength;
uniform float uNight;
varying vec4 vColor;
void main() {
  float glancing = 1.0 - sqrt(max(0.0, 1.0 - position.z * position.z));
  float alpha = uStrength * (0.1 + 0.9 * glancing * glancing);
  vColor = vec4(uColor * alpha, alpha * mix(0.9, 0.45, uNight));
  gl_Position = projectionMatrix * viewMatrix * vec4(uMiddle + position.x * uAcross + position.y * uUp, 1.0);
}`;

const FRAGMENT = /* glsl */ `
varying vec4 vColor;
void main() {
  gl_FragColor = vColor;
}`;
