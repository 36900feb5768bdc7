// Trails of all vehicles: a ring of samples on the graphics card, in which every sample is written once. A sample is
// a position and its time; a segment whose end is older than its beginning is the seam of the ring, and is not drawn.

import type { Shared } from "./camera";
import { STRIP, STRIP_EDGE } from "./glsl";
import { Repeated, stripShape, Table, telling } from "./instances";
import { ORDER } from "./materials";
import type { Poses } from "./playback";

const COLUMNS = 2; // x, y, z, time; red, green, blue, and whether it counts
const FLOATS = 4 * COLUMNS;
const SAMPLES_IN_ALL = 4_000;
const SLOTS_MAX = 96;
const SLOTS_MIN = 6;
const LASTS_S = 14; // about, where there is room for it
const OFTEN_S = 0.15;
const LEAP_M_S = 60; // faster than any vehicle here: a jump, not a path

/** How many samples each of n vehicles leaves. */
export function slotsFor(n: number): number {
  return Math.max(SLOTS_MIN, Math.min(SLOTS_MAX, Math.floor(SAMPLES_IN_ALL / Math.max(1, n))));
}

/** The samples, without a graphics card. Rows lie slot by slot; the last slot repeats the first, so that each row's successor lies n rows on. */
export class Ring {
  readonly slots: number;
  readonly every_s: number;
  readonly rows: Float32Array;
  readonly n: number;
  readonly run: number;
  head = 0;
  #head_s = -Infinity;

  /** Into the table, which it makes large enough. */
  constructor(n: number, table = new Table(COLUMNS), run = 0) {
    this.n = n;
    this.run = run;
    this.slots = slotsFor(n);
    this.every_s = Math.max(OFTEN_S, LASTS_S / this.slots);
    table.grow((this.slots + 1) * n);
    this.rows = table.numbers;
  }

  /** Whether these poses are joined to those before: after a break of recorded time a straight line would be wrong. */
  joins(poses: Poses): boolean {
    return poses.n === this.n && poses.run === this.run;
  }

  /** Write the position of each vehicle. */
  write(poses: Poses, colors: Float32Array, time_s: number): void {
    const goesOn = time_s - this.#head_s >= this.every_s;
    const before = this.head;
    if (goesOn) {
      this.head = (this.head + 1) % this.slots;
      this.#head_s = time_s;
    }
    for (let i = 0; i < this.n; i += 1) {
      const known = poses.known(i);
      const last = (before * this.n + i) * FLOATS;
      const at = (this.head * this.n + i) * FLOATS;
      if (!known || this.#leapt(poses, i, last, time_s)) {
        this.#wipe(i);
      }
      this.rows[at] = poses.place[4 * i]!;
      this.rows[at + 1] = poses.place[4 * i + 1]!;
      this.rows[at + 2] = poses.place[4 * i + 2]!;
      this.rows[at + 3] = time_s;
      this.rows[at + 4] = colors[4 * i]!;
      this.rows[at + 5] = colors[4 * i + 1]!;
      this.rows[at + 6] = colors[4 * i + 2]!;
      this.rows[at + 7] = known ? 1 : 0;
    }
    if (this.head === 0) {
      this.rows.copyWithin(this.slots * this.n * FLOATS, 0, this.n * FLOATS);
    }
  }

  #leapt(poses: Poses, i: number, last: number, time_s: number): boolean {
    if (this.rows[last + 7] === 0) {
      return false;
    }
    const far_m = Math.hypot(
      poses.place[4 * i]! - this.rows[last]!,
      poses.place[4 * i + 1]! - this.rows[last + 1]!,
      poses.place[4 * i + 2]! - this.rows[last + 2]!,
    );
    return far_m > 2 + LEAP_M_S * Math.abs(time_s - this.rows[last + 3]!);
  }

  /** Forget the trail of one vehicle. */
  #wipe(i: number): void {
    for (let slot = 0; slot <= this.slots; slot += 1) {
      this.rows[(slot * this.n + i) * FLOATS + 7] = 0;
    }
  }
}

export class Trails {
  readonly #all: Repeated;
  readonly #uniforms;
  readonly #shape = stripShape();
  #table = new Table(COLUMNS);
  #ring = new Ring(0);
  #begun_s = 0; // Unix time; the graphics card counts from here: its numbers are short

  constructor(shared: Shared) {
    this.#uniforms = {
      ...shared, uNow: { value: 0 }, uLasts: { value: 1 }, uSelected: { value: -1 }, uWidth: { value: 1.5 }, uN: { value: 0 },
    };
    this.#all = new Repeated({ uniforms: this.#uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT }, ORDER.trails);
  }

  get mesh(): Repeated["mesh"] {
    return this.#all.mesh;
  }

  /** The time is that of the recording: a paused replay keeps its trails, and a seek starts new ones. */
  draw(poses: Poses, colors: Float32Array, selected: number): void {
    if (!this.#ring.joins(poses)) {
      this.#begin(poses);
    }
    const since_s = poses.unix_time_s - this.#begun_s;
    this.#ring.write(poses, colors, since_s);
    this.#table.texture.needsUpdate = poses.n > 0;
    this.#uniforms.uNow.value = since_s;
    this.#uniforms.uSelected.value = selected;
    this.#all.draw(this.#shape, this.#table, this.#ring.slots * this.#ring.n);
  }

  #begin({ n, run, unix_time_s }: Poses): void {
    this.#table.texture.dispose();
    this.#table = new Table(COLUMNS);
    this.#ring = new Ring(n, this.#table, run);
    this.#begun_s = unix_time_s;
    this.#uniforms.uN.value = n;
    this.#uniforms.uLasts.value = this.#ring.slots * this.#ring.every_s;
    this.#uniforms.uWidth.value = n > 300 ? 1 : n > 60 ? 1.4 : 2;
  }

  dispose(): void {
    this.#all.dispose();
    this.#table.texture.dispose();
    this.#shape.dispose();
  }
}

const VERTEX = /* glsl */ `
uniform int uN;
uniform float uNow;
uniform float uLasts;
uniform float uSelected;
uniform float uWidth;
uniform float uNight;
varying vec4 vColor;
${telling(COLUMNS)}
${STRIP}
void main() {
  int row = int(aRow + 0.5);
  vec4 from = reportedOf(row, 0);
  vec4 fromColor = reportedOf(row, 1);
  vec4 to = reportedOf(row + uN, 0);
  vec4 toColor = reportedOf(row + uN, 1);
  float selected = abs(float(row % uN) - uSelected) < 0.5 ? 1.0 : 0.0;
  float fresh = 1.0 - (uNow - (position.x < 0.5 ? from.w : to.w)) / uLasts;
  if (fromColor.a * toColor.a < 0.5 || to.w < from.w || fresh <= 0.0) {
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    return;
  }
  gl_Position = strip(from.xyz, to.xyz, position.xy, uWidth * (1.0 + selected));
  vec3 rgb = position.x < 0.5 ? fromColor.rgb : toColor.rgb;
  vColor = vec4(rgb, fresh * fresh * mix(0.55, 0.9, selected));
}`;

const FRAGMENT = /* glsl */ `
uniform float uNight;
varying vec4 vColor;
${STRIP_EDGE}
void main() {
  float alpha = vColor.a * edge();
  gl_FragColor = vec4(vColor.rgb * alpha, alpha * mix(1.0, 0.25, uNight)); // at night nearly light on light
}`;
