/** The site in the scene: outlines on the ground, walls to their heights, labels; while it is edited, handles. */

import type { Group } from "three";
import type { FeatureLayer } from "../features/feature";
import { toScene, toShow, type Vec3 } from "../scene/axes";
import type { Eye, Shared } from "../scene/camera";
import { DECAL, Decals } from "../scene/decals";
import { rounded, step_m, type Sight } from "../scene/dragPreviews";
import { ORDER } from "../scene/materials";
import type { Overlay } from "../scene/overlay";
import type { Palette, Rgb } from "../scene/palette";
import { onLevel, project, type Ray } from "../scene/picking";
import { Strokes } from "../scene/strokes";
import { may, type State } from "../state";
import type { Area, AreaKind } from "./area";
import { shownAreas, type SiteEdit, type SiteState } from "./model";
import { t } from "./texts";
import { Walls } from "./walls";

const REACH_PX = 18;
const HANDLE_PX = 8;
const CHOSEN_PX = 13;
const SIDE_PX = 8;
const PANEL = "feature-site";

/** Each kind has a line of its own besides its colour. */
const LOOKS: Record<AreaKind, { color: (palette: Palette) => Rgb; width_px: number; dash_m: number }> = {
  "flight-geography": { color: (palette) => palette.setpoint, width_px: 2.2, dash_m: 0 },
  contingency: { color: (palette) => palette.caution, width_px: 1.8, dash_m: 8 },
  "ground-risk": { color: (palette) => palette.obstacle, width_px: 1.6, dash_m: 3 },
  audience: { color: (palette) => palette.phase.pilot, width_px: 3, dash_m: 0 },
  "no-fly": { color: (palette) => palette.danger, width_px: 2.4, dash_m: 5 },
};

/** A corner that is taken hold of, or a side where one is added. */
export interface CornerGrip {
  area: number;
  corner: number;
  isSide: boolean;
  off_x_m: number;
  off_y_m: number;
}

function middle(area: Area, k: number): { x_m: number; y_m: number } {
  const [from, to] = [area.corners[k]!, area.corners[(k + 1) % area.corners.length]!];
  return { x_m: (from.x_m + to.x_m) / 2, y_m: (from.y_m + to.y_m) / 2 };
}

/** What is under the pointer: of the chosen area before the others, a corner before a side. */
export function cornerGripAt(state: State, sight: Sight, ray: Ray, px: number, py: number): CornerGrip | null {
  const { edit } = state.site;
  const hand = edit === null || edit.isSaving || !may(state, "operate") ? null : onLevel(ray, 0);
  if (edit === null || hand === null) return null;
  const at = toShow(hand);
  const found = nearestHandle(edit, sight, px, py);
  return found === null ? null : { ...found.grip, off_x_m: found.x_m - at.x_m, off_y_m: found.y_m - at.y_m };
}

type Handle = { grip: Pick<CornerGrip, "area" | "corner" | "isSide">; x_m: number; y_m: number };

function nearestHandle(edit: SiteEdit, sight: Sight, px: number, py: number): Handle | null {
  const corners = (area: number): Handle[] =>
    edit.areas[area]!.corners.map(({ x_m, y_m }, corner) => ({ grip: { area, corner, isSide: false }, x_m, y_m }));
  const chosen = edit.areas[edit.area]!;
  const sides = chosen.corners.map((_, corner) => ({ grip: { area: edit.area, corner, isSide: true }, ...middle(chosen, corner) }));
  const others = edit.areas.flatMap((_, area) => (area === edit.area ? [] : corners(area)));
  for (const handles of [corners(edit.area), sides, others]) {
    let [nearest, least_px]: [Handle | null, number] = [null, REACH_PX];
    for (const each of handles) {
      const seen = project(sight.basis, sight.pose, sight.screen, toScene(each.x_m, each.y_m, 0));
      const off_px = seen === null ? Infinity : Math.hypot(seen.px - px, seen.py - py);
      if (off_px <= least_px) [nearest, least_px] = [each, off_px];
    }
    if (nearest !== null) return nearest;
  }
  return null;
}

/** Where the corner would be; null where the pointer is over nothing. */
export function cornerMoved(grip: CornerGrip, sight: Sight, ray: Ray): { x_m: number; y_m: number } | null {
  const hand = onLevel(ray, 0);
  if (hand === null) return null;
  const [at, step] = [toShow(hand), step_m(sight.pose.span_m, sight.screen.free.height)];
  return { x_m: rounded(at.x_m + grip.off_x_m, step), y_m: rounded(at.y_m + grip.off_y_m, step) };
}

export class SiteLayer implements FeatureLayer {
  readonly #walls: Walls;
  readonly #ground: Strokes;
  readonly #upper: Strokes;
  readonly #handles: Decals;
  #drawn: { site: SiteState; palette: Palette; span_m: number } | null = null;

  constructor(shared: Shared, into: Group) {
    this.#walls = new Walls(shared, ORDER.boxes);
    this.#ground = new Strokes(shared, ORDER.groundStrokes, { hidden: false });
    this.#upper = new Strokes(shared, ORDER.strokes);
    this.#handles = new Decals(shared);
    into.add(this.#ground.mesh, this.#walls.mesh, this.#upper.mesh, this.#handles.mesh);
  }

  draw(state: State, _time_s: number, palette: Palette, eye: Eye, overlay: Overlay): void {
    const { site } = state;
    const span_m = site.edit === null ? 0 : Math.round(eye.pose.span_m); // handles are as large at any zoom
    const last = this.#drawn;
    if (last === null || site !== last.site || palette !== last.palette || span_m !== last.span_m) {
      this.#drawn = { site, palette, span_m };
      this.#build(state, palette, eye);
    }
    const isOpen = state.panels.right === PANEL || state.view.camera === "top" || site.edit !== null;
    for (const area of shownAreas(site)) {
      const isOutside = area.kind === "audience" || area.kind === "no-fly";
      if (isOpen || isOutside) overlay.put(eye, labelOf(area), t.named(area.kind, area.name), "thing", isOutside ? 0 : -14);
    }
    const { edit } = site;
    const at = edit?.areas[edit.area]?.corners[edit.corner];
    if (edit !== null && at !== undefined) {
      overlay.put(eye, toScene(at.x_m, at.y_m, 0), `${t.corner(edit.corner + 1)} · ${t.at(at.x_m, at.y_m)}`, "preview", 26);
    }
  }

  #build(state: State, palette: Palette, eye: Eye): void {
    const parts = [this.#walls, this.#ground, this.#upper, this.#handles];
    parts.forEach((each) => each.clear());
    const top_m = state.status?.flight_envelope.height_max_m ?? 0;
    const { edit } = state.site;
    shownAreas(state.site).forEach((area, k) => this.#area(area, palette, top_m, edit === null || k === edit.area));
    if (edit !== null) this.#edited(edit, palette, eye);
    parts.forEach((each) => each.commit());
  }

  #area({ kind, corners, height_min_m, height_max_m }: Area, palette: Palette, top_m: number, isStrong: boolean): void {
    const { color: of, width_px, dash_m } = LOOKS[kind];
    const color = of(palette);
    const alpha = isStrong ? 0.95 : 0.45;
    const high_m = height_max_m ?? (kind === "ground-risk" ? 0 : top_m);
    const low_m = Math.max(0, height_min_m);
    let along_m = 0;
    corners.forEach((from, k) => {
      const to = corners[(k + 1) % corners.length]!;
      const [start, end] = [toScene(from.x_m, from.y_m, 0), toScene(to.x_m, to.y_m, 0)];
      this.#ground.line(start, end, { color, alpha, width_px, dash_m }, along_m);
      along_m += Math.hypot(to.x_m - from.x_m, to.y_m - from.y_m);
      if (high_m <= low_m) return;
      this.#walls.put(start, end, low_m, high_m, color, (palette.night ? 0.1 : 0.16) * alpha);
      this.#upper.line(toScene(from.x_m, from.y_m, high_m), toScene(to.x_m, to.y_m, high_m), { color, alpha: 0.4 * alpha, width_px: 1.2, dash_m });
      this.#upper.line(toScene(from.x_m, from.y_m, low_m), toScene(from.x_m, from.y_m, high_m), { color, alpha: 0.4 * alpha, width_px: 1 });
    });
  }

  #edited(edit: SiteEdit, palette: Palette, eye: Eye): void {
    const put = (place: { x_m: number; y_m: number }, color: Rgb, alpha: number, px: number, decal: number): void => {
      const at = toScene(place.x_m, place.y_m, 0);
      this.#handles.put(at, color, alpha, px * eye.pixelAt_m(at), decal);
    };
    const wrong = edit.problems.filter((each) => each.area === edit.area).flatMap((each) => each.corners);
    const area = edit.areas[edit.area]!;
    area.corners.forEach((_, k) => put(middle(area, k), palette.preview, 0.8, SIDE_PX, DECAL.spot));
    area.corners.forEach((each, k) => {
      const color = wrong.includes(k) ? palette.danger : palette.preview;
      put(each, color, 1, HANDLE_PX, DECAL.pad);
      if (k === edit.corner || wrong.includes(k)) put(each, color, 1, CHOSEN_PX, DECAL.target);
    });
  }

  questionAt(): null {
    return null;
  }

  dispose(): void {
    for (const each of [this.#walls, this.#ground, this.#upper, this.#handles]) each.dispose();
  }
}

/** Areas that lie within each other have their labels on different sides. */
function labelOf({ kind, corners }: Area): Vec3 {
  const most = (of: (x_m: number, y_m: number) => number): Vec3 => {
    const best = corners.reduce((a, b) => (of(b.x_m, b.y_m) > of(a.x_m, a.y_m) ? b : a));
    return toScene(best.x_m, best.y_m, 0);
  };
  switch (kind) {
    case "flight-geography":
      return most((x_m, y_m) => x_m - 0.1 * y_m);
    case "contingency":
      return most((x_m, y_m) => y_m - 0.1 * x_m);
    case "ground-risk":
      return most((x_m, y_m) => -x_m - 0.1 * y_m);
    default: {
      const sum = corners.reduce((all, each) => ({ x_m: all.x_m + each.x_m, y_m: all.y_m + each.y_m }), { x_m: 0, y_m: 0 });
      return toScene(sum.x_m / corners.length, sum.y_m / corners.length, 0);
    }
  }
}
