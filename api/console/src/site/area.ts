/** An area of the site, and where a new one is drawn: where the service takes it, if there is room. Pure. */

import type { SiteArea } from "../snapshot";

export type AreaKind = SiteArea["kind"];

export interface Place {
  x_m: number;
  y_m: number;
}

export interface Corner extends Place {
  /** As it was read, to the last digit; null: it was moved or added. */
  read: { latitude_deg: number; longitude_deg: number } | null;
}

export interface Area {
  kind: AreaKind;
  name: string;
  corners: readonly Corner[];
  height_min_m: number;
  height_max_m: number | null;
}

/** Each contains those before it, and a site has at most one of each. */
const NESTED: readonly AreaKind[] = ["flight-geography", "contingency", "ground-risk"];
export const AREA_KINDS: readonly AreaKind[] = [...NESTED, "audience", "no-fly"];
/** As `gcs.areas.site`. */
export const AREAS_MAX = 12;

const GROWN_M = 10; // a volume round another
const TOP_M = 40; // where no other area says how high
const SIDE_M = [6, 20] as const; // of a square: the service wants 25 m²
const SHARE = 8; // of the site's extent
const GRID = 12;
const GAP_M = 2;
const MITRE_LEAST = 0.3;

export const isNested = (kind: AreaKind): boolean => NESTED.includes(kind);
export const centimetres = (value_m: number): number => Math.round(100 * value_m) / 100;

/** With a name of its own, by which the service says what is wrong with it. */
export function newArea(areas: readonly Area[], kind: AreaKind): Area {
  const named = { kind, name: nameOf(areas, kind) };
  if (isNested(kind)) return { ...named, ...volume(areas, kind) };
  const side_m = Math.min(Math.max(extent_m(areas) / SHARE, SIDE_M[0]), SIDE_M[1]);
  const at = (kind === "no-fly" ? within(areas, side_m) : null) ?? beside(areas, side_m);
  return { ...named, corners: square(at, side_m).map(drawn), height_min_m: 0, height_max_m: null };
}

function nameOf(areas: readonly Area[], kind: AreaKind): string {
  const isTaken = (name: string): boolean => areas.some((each) => each.name === name);
  let [name, number] = [kind as string, 2];
  while (isTaken(name)) name = `${kind} ${number++}`;
  return name;
}

const drawn = ({ x_m, y_m }: Place): Corner => ({ x_m: centimetres(x_m), y_m: centimetres(y_m), read: null });

/** Round the one that it contains; where the one around it leaves no room, as large as that inside. */
function volume(areas: readonly Area[], kind: AreaKind): Pick<Area, "corners" | "height_min_m" | "height_max_m"> {
  const row = NESTED.indexOf(kind);
  const next = (kinds: readonly AreaKind[]): Area | undefined => kinds.map((each) => areas.find((area) => area.kind === each)).find((area) => area !== undefined);
  const [inner, outer] = [next(NESTED.slice(0, row).reverse()), next(NESTED.slice(row + 1))];
  const grown = inner === undefined ? [] : grownHull(inner.corners, GROWN_M).map(drawn);
  const fits = grown.length > 0 && (outer === undefined || grown.every((each) => isInside(each, outer.corners)));
  const corners = fits ? grown : ((inner ?? outer)?.corners ?? square({ x_m: 0, y_m: 0 }, 2 * SIDE_M[1]).map(drawn));
  if (kind === "ground-risk") return { corners, height_min_m: 0, height_max_m: null };
  const top_m = inner?.height_max_m == null ? (outer?.height_max_m ?? TOP_M) : inner.height_max_m + GROWN_M;
  return { corners, height_min_m: (inner ?? outer)?.height_min_m ?? 0, height_max_m: Math.min(top_m, outer?.height_max_m ?? Infinity) };
}

function bounds(places: readonly Place[]): { least: Place; greatest: Place } {
  const [x_m, y_m] = [places.map((each) => each.x_m), places.map((each) => each.y_m)];
  return { least: { x_m: Math.min(...x_m), y_m: Math.min(...y_m) }, greatest: { x_m: Math.max(...x_m), y_m: Math.max(...y_m) } };
}

function extent_m(areas: readonly Area[]): number {
  const { least, greatest } = bounds(areas.flatMap((each) => each.corners));
  return Math.max(greatest.x_m - least.x_m, greatest.y_m - least.y_m);
}

function square({ x_m, y_m }: Place, side_m: number): Place[] {
  const half_m = side_m / 2;
  return ([[-1, -1], [1, -1], [1, 1], [-1, 1]] as const).map(([x, y]) => ({ x_m: x_m + x * half_m, y_m: y_m + y * half_m }));
}

/** Right of all areas. */
function beside(areas: readonly Area[], side_m: number): Place {
  const { least, greatest } = bounds(areas.flatMap((each) => each.corners));
  return { x_m: (least.x_m + greatest.x_m) / 2, y_m: greatest.y_m + GROWN_M + side_m / 2 };
}

/** In the flight geography and clear of what is closed, as far from the show's origin as there is room; null: there is none. */
function within(areas: readonly Area[], side_m: number): Place | null {
  const field = areas.find((each) => each.kind === "flight-geography")?.corners;
  if (field === undefined) return null;
  const closed = areas.filter((each) => !isNested(each.kind));
  const { least, greatest } = bounds(field);
  const isFree = (at: Place): boolean => {
    const ring = square(at, side_m + 2 * GAP_M);
    const meets = (others: readonly Place[]): boolean => ring.some((each) => isInside(each, others)) || others.some((each) => isInside(each, ring));
    return ring.every((each) => isInside(each, field)) && !field.some((each) => isInside(each, ring)) && !closed.some((each) => meets(each.corners));
  };
  const steps = Array.from({ length: GRID - 1 }, (_, k) => (k + 1) / GRID);
  const grid = steps.flatMap((x) => steps.map((y) => ({ x_m: least.x_m + x * (greatest.x_m - least.x_m), y_m: least.y_m + y * (greatest.y_m - least.y_m) })));
  const far_m = ({ x_m, y_m }: Place): number => Math.hypot(x_m, y_m);
  return grid.filter(isFree).reduce<Place | null>((best, each) => (best === null || far_m(each) > far_m(best) ? each : best), null);
}

/** Whether an odd number of sides lies in front of it. */
export function isInside({ x_m, y_m }: Place, ring: readonly Place[]): boolean {
  return ring.reduce((inside, from, k) => {
    const to = ring[(k + 1) % ring.length]!;
    const isCrossed = from.y_m > y_m !== to.y_m > y_m && x_m < from.x_m + ((to.x_m - from.x_m) * (y_m - from.y_m)) / (to.y_m - from.y_m);
    return isCrossed ? !inside : inside;
  }, false);
}

/** The convex hull (Andrew's monotone chain), each side moved outwards; sharp corners are cut. */
function grownHull(places: readonly Place[], by_m: number): Place[] {
  const hull = hullOf(places);
  const outwards = hull.map((from, k) => {
    const to = hull[(k + 1) % hull.length]!;
    const length_m = Math.hypot(to.x_m - from.x_m, to.y_m - from.y_m);
    return { x: (to.y_m - from.y_m) / length_m, y: (from.x_m - to.x_m) / length_m };
  });
  return hull.map(({ x_m, y_m }, k) => {
    const [before, after] = [outwards.at(k - 1)!, outwards[k]!];
    const scale_m = by_m / Math.max(MITRE_LEAST, 1 + before.x * after.x + before.y * after.y);
    return { x_m: x_m + scale_m * (before.x + after.x), y_m: y_m + scale_m * (before.y + after.y) };
  });
}

function hullOf(places: readonly Place[]): Place[] {
  const sorted = [...places].sort((a, b) => a.x_m - b.x_m || a.y_m - b.y_m);
  const turns = (a: Place, b: Place, c: Place): number => (b.x_m - a.x_m) * (c.y_m - a.y_m) - (b.y_m - a.y_m) * (c.x_m - a.x_m);
  const chain = (all: readonly Place[]): Place[] => {
    const kept: Place[] = [];
    for (const each of all) {
      while (kept.length >= 2 && turns(kept.at(-2)!, kept.at(-1)!, each) <= 0) kept.pop();
      kept.push(each);
    }
    return kept.slice(0, -1);
  };
  return [...chain(sorted), ...chain(sorted.reverse())];
}
