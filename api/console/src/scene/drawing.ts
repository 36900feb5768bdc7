// A drawn show at the time of its preview: the vehicles with their lights, where they come from and where they go.

import type { Group } from "three";

import { colourAt, placeAt, shown_s, type DrawnPreview, type Drawing } from "../drawn/model";
import { carried, type Placing } from "../placing/model";
import { toScene, type Vec3 } from "./axes";
import { Billboards } from "./billboards";
import type { Shared } from "./camera";
import { Table } from "./instances";
import { ORDER } from "./materials";
import type { Palette, Rgb } from "./palette";
import type { Screen } from "./screen";
import { Strokes } from "./strokes";
import { REPORTED, Vehicles } from "./vehicles";

const DARKEST = 0.35; // as of vehicles that fly
const PATH_S = 6; // before and after
const SEGMENTS_MAX = 8_000;
const STEP_LEAST_S = 0.25;

export class DrawnLayer {
  readonly #table = new Table(REPORTED);
  readonly #vehicles;
  readonly #glows;
  readonly #paths;
  #moved: Placing | null = null;

  constructor(shared: Shared, into: Group) {
    this.#vehicles = new Vehicles(shared);
    this.#glows = new Billboards(shared);
    this.#paths = new Strokes(shared, ORDER.strokes);
    into.add(this.#vehicles.mesh, this.#glows.mesh, this.#paths.mesh);
  }

  dress(palette: Palette): void {
    this.#vehicles.dress(palette);
    this.#glows.dress(palette);
  }

  /** A show that is being placed moves with its pads. */
  draw(preview: DrawnPreview | null, placing: Placing | null, now_ms: number, free: Screen["free"]): void {
    this.#moved = placing !== null && placing.found.show === preview?.drawing.show ? placing : null;
    const n = preview?.drawing.n ?? 0;
    this.#paths.clear();
    if (preview !== null) {
      const time_s = shown_s(preview, now_ms);
      this.#tell(preview.drawing, time_s);
      this.#path(preview.drawing, time_s);
    }
    this.#paths.commit();
    this.#vehicles.draw(this.#table, n, free);
    this.#glows.draw(this.#table, n, free);
  }

  #tell(drawing: Drawing, time_s: number): void {
    this.#table.grow(drawing.n);
    const { numbers, texture } = this.#table;
    for (let i = 0; i < drawing.n; i += 1) {
      numbers.set([...this.#placeAt(drawing, i, time_s), 0, ...litOf(colourAt(drawing, i, time_s)), 0], 4 * REPORTED * i);
    }
    texture.needsUpdate = drawing.n > 0;
  }

  #placeAt(drawing: Drawing, i: number, time_s: number): Vec3 {
    const [x, y, height] = placeAt(drawing, i, time_s);
    return this.#moved === null ? toScene(x, y, height) : toScene(...carried([x, y], this.#moved.found.written, this.#moved.place), height);
  }

  /** In the light's colour where they were, fainter where they will be. */
  #path(drawing: Drawing, time_s: number): void {
    const step_s = Math.max(STEP_LEAST_S, (2 * PATH_S * drawing.n) / SEGMENTS_MAX);
    for (let i = 0; i < drawing.n; i += 1) {
      let last: Vec3 | null = null;
      for (let off_s = -PATH_S; off_s <= PATH_S; off_s += step_s) {
        const at_s = time_s + off_s;
        if (at_s < 0 || at_s > drawing.duration_s) continue;
        const place = this.#placeAt(drawing, i, at_s);
        if (last !== null && Number.isFinite(place[0] + last[0])) {
          const [red, green, blue] = litOf(colourAt(drawing, i, at_s));
          const alpha = (off_s <= 0 ? 0.75 : 0.3) * (1 - Math.abs(off_s) / (PATH_S + step_s));
          this.#paths.line(last, place, { color: [red, green, blue], alpha, width_px: off_s <= 0 ? 2 : 1.2 });
        }
        last = place;
      }
    }
  }

  dispose(): void {
    for (const each of [this.#vehicles, this.#glows, this.#paths]) {
      each.dispose();
    }
    this.#table.texture.dispose();
  }
}

/** Colour and shine of a vehicle with this light; one that is nearly off can still be seen. */
function litOf([red, green, blue]: Rgb): [number, number, number, number] {
  const bright = Math.max(red, green, blue);
  if (!(bright > 0)) {
    return [DARKEST, DARKEST, DARKEST, 0];
  }
  const scale = Math.max(DARKEST, bright) / bright;
  return [red * scale, green * scale, blue * scale, bright];
}
