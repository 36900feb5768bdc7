// Many of one shape in one draw call. What differs between them lies in a texture, a row for each, that the vertex
// shader reads: instanced drawing would be the same on a graphics card, but without one every instance is a draw call.

import {
  BufferAttribute, BufferGeometry, DataTexture, FloatType, Mesh, RGBAFormat, type ShaderMaterial,
} from "three";

import { material, type Recipe } from "./materials";

const PER_LINE = 64; // rows in a line of the texture
const ROOM_LEAST = 16;

/** For vertex shaders: `reported(k)` is column k of the vertex' own row, `reportedOf(row, k)` of any. */
export function telling(columns: number): string {
  return /* glsl */ `
uniform sampler2D uRows;
attribute float aRow;
vec4 reportedOf(int row, int column) {
  return texelFetch(uRows, ivec2((row % ${PER_LINE}) * ${columns} + column, row / ${PER_LINE}), 0);
}
vec4 reported(int column) { return reportedOf(int(aRow + 0.5), column); }`;
}

/** Rows of columns of four numbers, as a texture. */
export class Table {
  readonly columns: number;
  texture: DataTexture;
  room = 0;

  constructor(columns: number) {
    this.columns = columns;
    this.texture = this.#made(0);
  }

  get numbers(): Float32Array {
    return this.texture.image.data as Float32Array;
  }

  /** Room for so many rows at least; what was there stays. Returns whether there is another texture now. */
  grow(room: number): boolean {
    if (room <= this.room) {
      return false;
    }
    const old = this.texture;
    this.texture = this.#made(room);
    this.numbers.set(old.image.data as Float32Array);
    old.dispose();
    return true;
  }

  #made(room: number): DataTexture {
    const lines = Math.max(1, Math.ceil(room / PER_LINE));
    this.room = lines * PER_LINE;
    const numbers = new Float32Array(4 * this.columns * this.room);
    return new DataTexture(numbers, this.columns * PER_LINE, lines, RGBAFormat, FloatType);
  }
}

/** A mesh that repeats a shape for the rows of a table. */
export class Repeated {
  readonly mesh: Mesh<BufferGeometry, ShaderMaterial>;
  #shape: BufferGeometry | null = null;
  #room = 0;

  constructor(recipe: Recipe, order: number) {
    this.mesh = new Mesh(new BufferGeometry(), material({ ...recipe, uniforms: { ...recipe.uniforms, uRows: { value: null } } }));
    this.mesh.frustumCulled = false;
    this.mesh.visible = false;
    this.mesh.renderOrder = order;
  }

  /** Draw n of a shape, which must have an index. */
  draw(shape: BufferGeometry, table: Table, n: number): void {
    this.mesh.visible = n > 0;
    if (shape !== this.#shape || n > this.#room) {
      this.#room = Math.max(ROOM_LEAST, shape === this.#shape ? 2 * this.#room : 0, n);
      this.#shape = shape;
      this.mesh.geometry.dispose();
      this.mesh.geometry = repeated(shape, this.#room);
    }
    this.mesh.material.uniforms["uRows"]!.value = table.texture;
    this.mesh.geometry.setDrawRange(0, n * shape.getIndex()!.count);
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}

/** The shape's vertices n times, each with its row. */
function repeated(shape: BufferGeometry, n: number): BufferGeometry {
  const whole = new BufferGeometry();
  const count = shape.getAttribute("position").count;
  for (const [name, { array, itemSize }] of Object.entries(shape.attributes)) {
    const many = new Float32Array(n * array.length);
    for (let k = 0; k < n; k += 1) {
      many.set(array as Float32Array, k * array.length);
    }
    whole.setAttribute(name, new BufferAttribute(many, itemSize));
  }
  whole.setAttribute("aRow", new BufferAttribute(new Float32Array(n * count).map((_, k) => Math.floor(k / count)), 1));
  const one = shape.getIndex()!.array;
  const index = new Uint32Array(n * one.length).map((_, k) => one[k % one.length]! + count * Math.floor(k / one.length));
  whole.setIndex(new BufferAttribute(index, 1));
  return whole;
}

/** Objects of one shape that are collected again now and then. */
export class Collected {
  readonly #repeated: Repeated;
  readonly #table: Table;
  readonly #shape: BufferGeometry;
  #n = 0;

  constructor(shape: BufferGeometry, columns: number, recipe: Recipe, order: number) {
    this.#shape = shape;
    this.#table = new Table(columns);
    this.#repeated = new Repeated(recipe, order);
  }

  get mesh(): Mesh<BufferGeometry, ShaderMaterial> {
    return this.#repeated.mesh;
  }

  clear(): void {
    this.#n = 0;
  }

  /** Add one; values that are not given are 0. */
  add(...row: number[]): void {
    this.#table.grow(this.#n < this.#table.room ? 0 : 2 * this.#n);
    this.#table.numbers.set(row, this.#n * 4 * this.#table.columns);
    this.#n += 1;
  }

  /** Upload the collected objects to the graphics card. */
  commit(): void {
    this.#table.texture.needsUpdate = this.#n > 0;
    this.#repeated.draw(this.#shape, this.#table, this.#n);
  }

  dispose(): void {
    this.#repeated.dispose();
    this.#table.texture.dispose();
    this.#shape.dispose();
  }
}

/** Two triangles, x 0 to 1 along, y -1 to 1 across. */
export function stripShape(): BufferGeometry {
  const shape = new BufferGeometry();
  shape.setAttribute("position", new BufferAttribute(new Float32Array([0, -1, 0, 1, -1, 0, 0, 1, 0, 1, 1, 0]), 3));
  shape.setIndex([0, 1, 2, 2, 1, 3]);
  return shape;
}
