// The shape of a vehicle: looks along -z, its rotors reach about 1 from its middle. By numbers, no file.

import { BufferAttribute, BufferGeometry } from "three";

type Point = readonly [number, number, number];

const STRUCTURE = 0;
const COLOR = 1;
const NOSE = 2;
const ROTORS: readonly Point[] = [[0.6, 0.1, -0.56], [-0.6, 0.1, -0.56], [0.6, 0.1, 0.6], [-0.6, 0.1, 0.6]];

class Maker {
  readonly #points: Point[] = [];
  readonly #normals: Point[] = [];
  readonly #paints: number[] = [];
  readonly #index: number[] = [];

  /** A flat one with its corners in turn. */
  polygon(corners: readonly Point[], paint: number): void {
    const first = this.#points.length;
    const normal = upwards(corners[0]!, corners[1]!, corners[2]!);
    for (const corner of corners) {
      this.#points.push(corner);
      this.#normals.push(normal);
      this.#paints.push(paint);
    }
    for (let k = 2; k < corners.length; k += 1) {
      this.#index.push(first, first + k - 1, first + k);
    }
  }

  /** A level ring. */
  ring([x, y, z]: Point, inner: number, outer: number, parts: number): void {
    const first = this.#points.length;
    for (let k = 0; k < parts; k += 1) {
      const turn = (2 * Math.PI * (k + 0.5)) / parts;
      for (const radius of [inner, outer]) {
        this.#points.push([x + radius * Math.cos(turn), y, z + radius * Math.sin(turn)]);
        this.#normals.push([0, 1, 0]);
        this.#paints.push(COLOR);
      }
      const [a, b] = [first + 2 * k, first + 2 * ((k + 1) % parts)];
      this.#index.push(a, a + 1, b + 1, a, b + 1, b);
    }
  }

  made(): BufferGeometry {
    const shape = new BufferGeometry();
    shape.setAttribute("position", new BufferAttribute(new Float32Array(this.#points.flat()), 3));
    shape.setAttribute("normal", new BufferAttribute(new Float32Array(this.#normals.flat()), 3));
    shape.setAttribute("aPaint", new BufferAttribute(new Float32Array(this.#paints), 1));
    shape.setIndex(this.#index);
    return shape;
  }
}

/** Across a triangle, of length 1, on the side that is seen from above. */
function upwards(a: Point, b: Point, c: Point): Point {
  const u: Point = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
  const v: Point = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
  const across: Point = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  const length = (Math.hypot(...across) || 1) * (across[1] < 0 ? -1 : 1);
  return [across[0] / length, across[1] / length, across[2] / length];
}

/** Rotors with so many corners; with 4 the whole is as simple as it gets. */
export function quadrotor(corners: number): BufferGeometry {
  const maker = new Maker();
  for (const rotor of ROTORS) {
    if (corners > 4) {
      arm(maker, rotor);
      maker.ring(rotor, 0.22, 0.38, corners);
    } else {
      const [x, y, z] = rotor;
      maker.polygon([[x - 0.3, y, z], [x, y, z - 0.3], [x + 0.3, y, z], [x, y, z + 0.3]], COLOR);
    }
  }
  hull(maker);
  return maker.made();
}

/** A strip from the middle to a rotor. */
function arm(maker: Maker, [x, y, z]: Point): void {
  const scale = 0.06 / Math.hypot(x, z);
  const [ox, oz] = [-z * scale, x * scale];
  maker.polygon([[ox, 0.04, oz], [-ox, 0.04, -oz], [x - ox, y - 0.02, z - oz], [x + ox, y - 0.02, z + oz]], STRUCTURE);
}

/** A dart with a ridge: its point is the nose. */
function hull(maker: Maker): void {
  const ridge: Point = [0, 0.26, 0.12];
  const tip: Point = [0, 0.08, -0.98];
  const [left, right]: [Point, Point] = [[-0.3, 0.06, 0.05], [0.3, 0.06, 0.05]];
  const [leftBack, rightBack]: [Point, Point] = [[-0.2, 0.06, 0.52], [0.2, 0.06, 0.52]];
  const from = 0.42; // where the nose's paint begins
  const before = (a: Point): Point => [
    a[0] + from * (tip[0] - a[0]), a[1] + from * (tip[1] - a[1]), a[2] + from * (tip[2] - a[2]),
  ];
  maker.polygon([left, ridge, before(ridge), before(left)], COLOR);
  maker.polygon([ridge, right, before(right), before(ridge)], COLOR);
  maker.polygon([before(left), before(ridge), tip], NOSE);
  maker.polygon([before(ridge), before(right), tip], NOSE);
  maker.polygon([left, leftBack, ridge], COLOR);
  maker.polygon([leftBack, rightBack, ridge], COLOR);
  maker.polygon([rightBack, right, ridge], COLOR);
}
