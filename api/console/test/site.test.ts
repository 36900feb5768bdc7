import { describe, expect, it } from "vitest";

import { createReader } from "../src/panels/reading";
import { toScene } from "../src/scene/axes";
import { worthSeeing } from "../src/scene/framing";
import { project, rayThrough, type Screen } from "../src/scene/picking";
import { Poses } from "../src/scene/playback";
import { basisOf, START } from "../src/scene/rig";
import { cornerGripAt, cornerMoved } from "../src/site/layer";
import { AREA_KINDS, isInside, newArea, type Area, type AreaKind } from "../src/site/area";
import { geojson, problemOf, shownAreas, type SiteMessage, type SiteState, type Step, updateSite } from "../src/site/model";
import { sitePanel } from "../src/site/panel";
import { t } from "../src/site/texts";
import type { Site, State } from "../src/state";
import { frame } from "./frames";
import { access, live, page, settled } from "./pages";
import { press, textOf } from "./pressing";
import { GROUNDED, status } from "./statuses";

const PLACES = [[-40, -40], [-40, 110], [110, 110], [110, -40]] as const;
/** About the origin of `status()`, at 47.4, 8.5. */
const corner = ([x_m, y_m]: readonly [number, number]) => ({ x_m, y_m, latitude_deg: 47.4 + x_m / 111_186, longitude_deg: 8.5 + y_m / 75_457 });
const SITE: Site = {
  name: "meadow", file: "meadow.geojson", hash: "a".repeat(64), version: "b".repeat(64), in_force: "a".repeat(64), pending: "",
  areas: [
    { kind: "flight-geography", name: "field", corners: PLACES.map(corner), height_min_m: 0, height_max_m: 45 },
    { kind: "no-fly", name: "mast", corners: ([[50, 50], [50, 60], [60, 60]] as const).map(corner), height_min_m: 0, height_max_m: null },
  ],
};
const FEATURES = { ...status().features, site: { hash: SITE.hash, version: SITE.version, pending: "" } };
const ON_GROUND = status({ counts: GROUNDED, show: { ...status().show, phase: "idle", possible: ["start"] }, features: FEATURES });

const after = (site: SiteState, ...messages: SiteMessage[]): SiteState => messages.reduce(updateSite, site);
const BEGUN = after({ stored: SITE, edit: null }, { kind: "site-edit", how: "begin" });
const step = (made: Step, gesture = ""): SiteMessage => ({ kind: "site-step", step: made, gesture });
const moved = (x_m: number, y_m: number, gesture = ""): SiteMessage => step({ what: "move", area: 0, corner: 0, x_m, y_m }, gesture);
const places = (site: SiteState, area = 0) => shownAreas(site)[area]!.corners.map(({ x_m, y_m }) => [x_m, y_m]);

describe("an edited site", () => {
  it("moves, adds and removes corners, and takes each back", () => {
    const made = after(BEGUN, moved(-42.5, -41), step({ what: "add", area: 0, corner: 3 }), step({ what: "remove", area: 0, corner: 1 }));
    expect(places(made)).toEqual([[-42.5, -41], [110, 110], [110, -40], [33.75, -40.5]]);
    const undo: SiteMessage = { kind: "site-edit", how: "undo" };
    expect(places(after(made, undo))).toHaveLength(5);
    expect(places(after(made, undo, undo, undo))).toEqual(PLACES.map((each) => [...each]));
    expect(after(made, undo, undo, undo, undo).edit!.past).toEqual([]);
    const redo: SiteMessage = { kind: "site-edit", how: "redo" };
    expect(places(after(made, undo, undo, redo, redo))).toEqual(places(made));
    expect(after(made, undo, moved(0, 0)).edit!.future).toEqual([]);
  });

  it("takes a whole drag back at once, but not two", () => {
    const dragged = after(BEGUN, moved(-41, -40, "drag:1"), moved(-45, -40, "drag:1"), moved(-50, -40, "drag:2"));
    expect(dragged.edit!.past).toHaveLength(2);
    expect(places(after(dragged, { kind: "site-edit", how: "undo" }))[0]).toEqual([-45, -40]);
  });

  it("keeps three corners, and does nothing for what is not there", () => {
    for (const made of [
      step({ what: "remove", area: 1, corner: 0 }), step({ what: "move", area: 0, corner: 9, x_m: 0, y_m: 0 }), step({ what: "add", area: 7, corner: 0 }),
      moved(NaN, 0), moved(-40, -40), step({ what: "height", area: 0, key: "height_min_m", value_m: null }),
    ]) expect(after(BEGUN, made)).toEqual(BEGUN);
  });

  it("changes heights, and can have none above", () => {
    const made = after(BEGUN, step({ what: "height", area: 0, key: "height_max_m", value_m: 60 }), step({ what: "height", area: 1, key: "height_min_m", value_m: 5 }));
    expect(shownAreas(made).map((each) => [each.height_min_m, each.height_max_m])).toEqual([[0, 60], [5, null]]);
  });

  it("has whole areas added and removed, each in one step", () => {
    const undo: SiteMessage = { kind: "site-edit", how: "undo" };
    const added = after(BEGUN, step({ what: "add-area", kind: "no-fly" }));
    expect(shownAreas(added).map((each) => [each.kind, each.name])).toEqual([["flight-geography", "field"], ["no-fly", "mast"], ["no-fly", "no-fly"]]);
    expect([added.edit!.area, added.edit!.corner, added.edit!.past.length]).toEqual([2, 0, 1]);
    const made = after(added, step({ what: "remove-area", area: 1 }), step({ what: "add-area", kind: "no-fly" }));
    expect(shownAreas(made).map((each) => each.name)).toEqual(["field", "no-fly", "no-fly 2"]);
    expect(shownAreas(after(made, undo, undo)).map((each) => each.name)).toEqual(["field", "mast", "no-fly"]);
    expect(shownAreas(after(made, undo, undo, undo))).toEqual(shownAreas(BEGUN));
    expect(after(added, undo).edit!.area).toBe(1);
  });

  it("keeps one area, at most twelve, and one of each volume", () => {
    const lone = after(BEGUN, step({ what: "remove-area", area: 1 }));
    expect(lone.edit!.areas).toHaveLength(1);
    expect(after(lone, step({ what: "remove-area", area: 0 }))).toEqual(lone);
    expect(after(BEGUN, step({ what: "remove-area", area: 7 }), step({ what: "add-area", kind: "flight-geography" }))).toEqual(BEGUN);
    const full = after(BEGUN, ...Array.from({ length: 12 }, () => step({ what: "add-area", kind: "audience" })));
    expect(full.edit!.areas).toHaveLength(12);
    expect(new Set(full.edit!.areas.map((each) => each.name)).size).toBe(12);
  });

  it("is stored as GeoJSON with what was not moved as it was read", () => {
    const text = geojson(after(BEGUN, moved(-30, -40)).edit!, ON_GROUND.origin);
    const { type, name, features } = JSON.parse(text) as { type: string; name: string; features: { properties: object; geometry: { coordinates: number[][][] } }[] };
    expect([type, name, features.length]).toEqual(["FeatureCollection", "meadow", 2]);
    expect(features.map((each) => each.properties)).toEqual([
      { kind: "flight-geography", name: "field", height_min_m: 0, height_max_m: 45 }, { kind: "no-fly", name: "mast", height_min_m: 0 },
    ]);
    const ring = features[0]!.geometry.coordinates[0]!;
    expect(ring).toHaveLength(5);
    expect(ring[4]).toEqual(ring[0]);
    const read = SITE.areas[0]!.corners[2]!;
    expect(ring[2]).toEqual([Number(read.longitude_deg.toFixed(7)), Number(read.latitude_deg.toFixed(7))]);
    expect(ring[0]![1]).toBeCloseTo(47.4 - 30 / 111_186, 5);
  });

  it("knows where a problem is, by number and by name", () => {
    const { areas } = BEGUN.edit!;
    const found = (text: string) => { const { area, corners } = problemOf(areas, text); return [area, ...corners]; };
    expect(found("area 1, flight-geography 'field': its sides cross or touch each other, side 1-2 and side 3-4: give it a simple outline")).toEqual([0, 0, 1, 2, 3]);
    expect(found("area 2, no-fly 'mast': corners 1 and 3 are the same place: leave one of them out")).toEqual([1, 0, 2]);
    expect(found("no-fly 'mast' reaches 2.0 m out of contingency 'outer' at its corner 2: it must lie inside")).toEqual([1, 1]);
    expect(found("61 corners in all go to the autopilots: at most 64, the most of PX4; leave corners out of no-fly 'mast'")).toEqual([1]);
    expect(found("area 9, audience 'x': 2 corners: 3 to 60 are possible")).toEqual([-1]);
    expect(found("site: features: at most 12")).toEqual([-1]);
  });

  it("shows a refusal at its corner until something is changed", () => {
    const refused = after(BEGUN, moved(0, 0), { kind: "site-saving" }, { kind: "site-refused", reason: "site = as it was sent: area 2, no-fly 'mast': corner 2: at most 90\nother" });
    const { edit } = refused;
    expect([edit!.area, edit!.corner, edit!.isSaving]).toEqual([1, 1, false]);
    expect(edit!.problems.map((each) => each.text)).toEqual(["area 2, no-fly 'mast': corner 2: at most 90", "other"]);
    expect(after(refused, moved(1, 1)).edit!.problems).toEqual([]);
  });

  it("changes nothing while it is stored, and ends once it is", () => {
    const saving = after(BEGUN, moved(0, 0), { kind: "site-saving" });
    expect(after(saving, moved(5, 5), { kind: "site-edit", how: "undo" })).toEqual(saving);
    expect(after(saving, { kind: "site", site: SITE, isSaved: true }).edit).toBeNull();
    expect(after(saving, { kind: "site", site: SITE, isSaved: false }).edit).toEqual(saving.edit);
  });
});

describe("a new area", () => {
  const drawn = (kind: AreaKind, areas: readonly Area[] = BEGUN.edit!.areas): Area => newArea(areas, kind);
  const [field, mast] = BEGUN.edit!.areas as [Area, Area];
  const all = (area: Area, of: Area): boolean => area.corners.every((each) => isInside(each, of.corners));

  it("that is closed lies in the field, clear of what is closed already and of the origin", () => {
    const area = drawn("no-fly");
    expect(all(area, field)).toBe(true);
    expect(area.corners.some((each) => isInside(each, mast.corners)) || mast.corners.some((each) => isInside(each, area.corners))).toBe(false);
    expect(Math.min(...area.corners.map(({ x_m, y_m }) => Math.hypot(x_m, y_m)))).toBeGreaterThan(20);
    const again = drawn("no-fly", [field, mast, area]);
    expect(again.corners.some((each) => isInside(each, area.corners))).toBe(false);
  });

  it("of people lies beside all others", () => {
    const area = drawn("audience", [field, mast, drawn("contingency")]);
    expect(Math.min(...area.corners.map((each) => each.y_m))).toBeGreaterThan(120);
  });

  it("of volume lies round the one that it contains, and within the one around", () => {
    const contingency = drawn("contingency");
    expect([all(field, contingency), contingency.height_min_m, contingency.height_max_m]).toEqual([true, 0, 55]);
    const ground = drawn("ground-risk", [field, contingency]);
    expect([all(contingency, ground), ground.height_max_m]).toEqual([true, null]);
    const tight = drawn("contingency", [field, { ...field, kind: "ground-risk", height_max_m: 50 }]);
    expect([tight.corners.map(({ x_m, y_m }) => [x_m, y_m]), tight.height_max_m]).toEqual([PLACES.map((each) => [...each]), 50]);
    const fly = drawn("flight-geography", [contingency]);
    expect([fly.corners.length, fly.height_max_m]).toEqual([4, 55]);
    expect(drawn("flight-geography", [mast]).height_max_m).toBe(40);
  });

  it("has no side across another, and room enough, in any field", () => {
    const thin: Area = { ...field, corners: ([[0, 0], [300, 4], [0, 8]] as const).map(([x_m, y_m]) => ({ x_m, y_m, read: null })) };
    for (const from of [field, thin]) for (const kind of AREA_KINDS) {
      const { corners } = drawn(kind, kind === "flight-geography" ? [{ ...from, kind: "contingency" }] : [from]);
      const twice_m2 = corners.reduce((sum, { x_m, y_m }, k) => { const to = corners[(k + 1) % corners.length]!; return sum + x_m * to.y_m - to.x_m * y_m; }, 0);
      expect(Math.abs(twice_m2) / 2).toBeGreaterThan(25);
      expect(new Set(corners.map(({ x_m, y_m }) => `${x_m} ${y_m}`)).size).toBe(corners.length);
    }
    expect(drawn("contingency", [thin]).corners.every(({ x_m }) => x_m < 340)).toBe(true);
  });
});

describe("the panel of a site", () => {
  const state = (site: SiteState, change: Partial<State> = {}) => live({ status: ON_GROUND, frame: frame({ vehicles: [{ phase: "standby" }] }), site, ...change });

  it("lists areas, and says what is pending", () => {
    const { actions } = page(state(BEGUN), () => undefined, "");
    const text = textOf(sitePanel(state({ stored: { ...SITE, pending: "it counts from the next start" }, edit: null }), actions, ""));
    for (const part of ["meadow", "flight geography · field", "4 corners", "0 m to 45 m", "no-fly · mast", "from 0 m", "it counts from the next start"]) expect(text).toContain(part);
  });

  it("can be edited on the ground only, and says why not", () => {
    const { actions } = page(state(BEGUN), () => undefined, "");
    const flying = state({ stored: SITE, edit: null }, { status: status({ features: FEATURES }) });
    expect(textOf(sitePanel(flying, actions, ""))).toContain("aria-disabled=true");
    expect(textOf(sitePanel(state(BEGUN), actions, ""))).toContain(t.unchanged);
  });

  it("says of which kind there is an area already, and removes the chosen one", () => {
    const all = page(state(after(BEGUN, step({ what: "add-area", kind: "contingency" }))), () => undefined, "");
    expect(all.state().site.edit!.areas.map((each) => each.kind)).toEqual(["flight-geography", "no-fly", "contingency"]);
    press(sitePanel(all.state(), all.actions, ""), "site-add-contingency");
    expect(all.state().site.edit!.areas).toHaveLength(3);
    expect(textOf(sitePanel(all.state(), all.actions, ""))).toContain("A site has one contingency volume.");
    press(sitePanel(all.state(), all.actions, ""), "site-area-remove");
    expect(all.state().site.edit!.areas.map((each) => each.kind)).toEqual(["flight-geography", "no-fly"]);
  });

  it("keeps a number that was typed just before the other, in the same view", () => {
    const all = page(state(BEGUN), () => undefined, "");
    const view = sitePanel(all.state(), all.actions, "");
    press(view, "site-x", "change", { value: "-45" });
    press(view, "site-y", "change", { value: "-50" });
    expect(places(all.state().site)[0]).toEqual([-45, -50]);
  });

  it("names a kind once", () => {
    const names = [["no-fly", "no-fly"], ["no-fly", "no-fly 2"], ["contingency", "contingency volume"], ["ground-risk", "ground-risk"], ["no-fly", "mast 2"]] as const;
    expect(names.map(([kind, name]) => t.named(kind, name))).toEqual(["no-fly", "no-fly 2", "contingency volume", "ground risk buffer", "no-fly · mast 2"]);
  });

  it("stores what was edited, of the version that was read, and shows a refusal", async () => {
    const all = page(state(after(BEGUN, moved(-41, -40))), () => undefined, "area 1, flight-geography 'field': corner 1: no");
    press(sitePanel(all.state(), all.actions, ""), "site-save");
    await settled();
    expect(all.state().site.edit!.problems.map((each) => [each.area, each.corners, each.text])).toEqual([[0, [0], "area 1, flight-geography 'field': corner 1: no"]]);
    expect(textOf(sitePanel(all.state(), all.actions, ""))).toContain("corner 1: no");
  });

  it("is read once, and again when the service has another version", () => {
    let reads = 0;
    const nothing = async (): Promise<boolean> => true;
    const read = createReader({
      loadPreflight: nothing, loadOrders: nothing, loadStations: nothing, loadPlacement: nothing, loadShows: nothing, loadMarks: nothing, loadFeatures: nothing,
      loadSite: () => ((reads += 1), Promise.resolve(true)),
    });
    const at = (page_ms: number, change: Partial<State>) => read({ ...live({ status: ON_GROUND, frame: frame({}), access: access(["watch"]), ...change }), page_ms });
    at(0, {});
    expect(reads).toBe(1);
    at(5000, { site: { stored: SITE, edit: null } });
    expect(reads).toBe(1);
  });
});

describe("corners in the scene", () => {
  const SCREEN: Screen = { width: 900, height: 600, free: { left: 0, top: 0, width: 900, height: 600 } };
  const POSE = { ...START, focus: toScene(0, 0, 0), elevation: 1.3, span_m: 300 };
  const sight = { basis: basisOf(POSE), pose: POSE, screen: SCREEN };
  const at = (x_m: number, y_m: number) => project(sight.basis, POSE, SCREEN, toScene(x_m, y_m, 0))!;
  const grip = (state: State, x_m: number, y_m: number) => {
    const { px, py } = at(x_m, y_m);
    return cornerGripAt(state, sight, rayThrough(sight.basis, POSE, SCREEN, px, py), px, py);
  };
  const state = live({ status: ON_GROUND, site: BEGUN });

  it("are taken hold of, sides to add one, and those of other areas", () => {
    expect(grip(state, -40, 110)).toMatchObject({ area: 0, corner: 1, isSide: false });
    expect(grip(state, 35, 110)).toMatchObject({ area: 0, corner: 1, isSide: true });
    expect(grip(state, 50, 50)).toMatchObject({ area: 1, isSide: false });
    expect(grip(state, 0, 0)).toBeNull();
  });

  it("are left alone by viewers, and while nothing is edited", () => {
    expect(grip(live({ status: ON_GROUND, site: BEGUN, access: access(["watch"]) }), -40, 110)).toBeNull();
    expect(grip(live({ status: ON_GROUND, site: { stored: SITE, edit: null } }), -40, 110)).toBeNull();
  });

  it("follow the pointer on the ground", () => {
    const { px, py } = at(-30, 90);
    const place = cornerMoved(grip(state, -40, 110)!, sight, rayThrough(sight.basis, POSE, SCREEN, px, py))!;
    expect(place.x_m).toBeCloseTo(-30, -0.5);
    expect(place.y_m).toBeCloseTo(90, -0.5);
  });

  it("are all in the picture while they are edited", () => {
    const seen = [...worthSeeing(live({ status: ON_GROUND, frame: frame({}), site: BEGUN }), new Poses(), [])];
    expect(seen).toHaveLength(7);
  });
});
