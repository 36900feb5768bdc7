import { expect, test } from "vitest";

import { addressOf, choose, columnOf, fromShowFrame, placeAt, rowOf, toShowFrame, zoomFor, type Origin } from "../src/scene/mercator";
import { HELD_MAX, RETRY_MS, TileCache } from "../src/scene/tileCache";
import { requestFor } from "../src/connection/tiles";

const ZURICH: Origin = { latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_amsl_m: 488, heading_deg: 0 };
const TURNED: Origin = { ...ZURICH, heading_deg: 30 };
const SYDNEY: Origin = { latitude_deg: -33.9, longitude_deg: 151.2, altitude_amsl_m: 20, heading_deg: 250 };
const ALL = { zoom_min: 0, zoom_max: 19 };

test.each([
  // as gcs.model.frames.ShowFrame.position_m tells them
  [ZURICH, 0.001, 0, 111.1871, 0],
  [ZURICH, 0, 0.001, 0.0005, 75.4955],
  [ZURICH, 0.02, -0.03, 2224.1824, -2264.008],
  [TURNED, 0.001, 0, 96.2909, -55.5936],
  [TURNED, 0.02, -0.03, 794.1945, -3072.7796],
  [SYDNEY, 0, 0.001, -86.915, -31.635],
  [SYDNEY, 0.02, -0.03, 1849.4596, 3033.5049],
])("places are where the service has them in the show frame, and back", (origin, north_deg, east_deg, x_m, y_m) => {
  const place = { latitude_deg: origin.latitude_deg + north_deg, longitude_deg: origin.longitude_deg + east_deg };
  const found = toShowFrame(place, origin);
  expect(found.x_m).toBeCloseTo(x_m, 3);
  expect(found.y_m).toBeCloseTo(y_m, 3);
  const back = fromShowFrame(x_m, y_m, origin);
  expect(back.latitude_deg).toBeCloseTo(place.latitude_deg, 8);
  expect(back.longitude_deg).toBeCloseTo(place.longitude_deg, 8);
});

test("tiles are numbered as is usual, from the north-west", () => {
  expect([Math.floor(columnOf(8.545594, 17)), Math.floor(rowOf(47.397742, 17))]).toEqual([68647, 45888]);
  expect([Math.floor(columnOf(-0.1278, 10)), Math.floor(rowOf(51.5074, 10))]).toEqual([511, 340]); // London
  expect([columnOf(-180, 3), rowOf(85.0511287798, 3)].map((each) => Math.round(each * 1e6))).toEqual([0, 0]);
  const place = placeAt(columnOf(151.2, 12), rowOf(-33.9, 12), 12);
  expect(place.longitude_deg).toBeCloseTo(151.2, 9);
  expect(place.latitude_deg).toBeCloseTo(-33.9, 9);
});

test("the farther the camera sees, the coarser the map, within what there is", () => {
  const zooms = [0.02, 0.1, 0.4, 2.2, 10].map((pixel_m) => zoomFor(47.4, pixel_m, ALL));
  expect(zooms).toEqual([19, 19, 18, 15, 13]);
  expect(zoomFor(47.4, 0.1, { zoom_min: 3, zoom_max: 15 })).toBe(15);
  expect(zoomFor(47.4, 10, { zoom_min: 16, zoom_max: 18 })).toBe(16);
  for (let pixel_m = 0.3; pixel_m < 50; pixel_m *= 1.1) {
    const zoom = zoomFor(ZURICH.latitude_deg, pixel_m, ALL);
    const next = placeAt(columnOf(ZURICH.longitude_deg, zoom) + 1, rowOf(ZURICH.latitude_deg, zoom), zoom);
    const shown_px = toShowFrame(next, ZURICH).y_m / 256 / pixel_m; // of a pixel of the map
    expect(shown_px).toBeGreaterThan(0.8);
    expect(shown_px).toBeLessThan(1.65);
  }
});

test("few tiles are chosen, all around where the camera looks, what covers most first", () => {
  const { tiles, reach_m } = choose(TURNED, 700, -300, 0.4, ALL);
  expect(tiles.length).toBeLessThanOrEqual(HELD_MAX);
  expect(tiles.map((tile) => tile.zoom)).toEqual([...Array<number>(25).fill(16), ...Array<number>(36).fill(18)]);
  const { latitude_deg, longitude_deg } = fromShowFrame(700, -300, TURNED);
  const here = { zoom: 16, column: Math.floor(columnOf(longitude_deg, 16)), row: Math.floor(rowOf(latitude_deg, 16)) };
  expect(tiles[0]).toEqual(here);
  const names = new Set(tiles.map((tile) => addressOf(tile, "{z}/{x}/{y}")));
  expect(names.size).toBe(tiles.length);
  for (let turn = 0; turn < 8; turn += 1) {
    const edge = fromShowFrame(700 + reach_m * Math.cos(turn), -300 + reach_m * Math.sin(turn), TURNED);
    const at = [16, columnOf(edge.longitude_deg, 16), rowOf(edge.latitude_deg, 16)].map(Math.floor).join("/");
    expect(names).toContain(at);
  }
});

test("a map without coarser tiles, the date line and the poles", () => {
  expect(choose(ZURICH, 0, 0, 0.4, { zoom_min: 18, zoom_max: 19 }).tiles.every((tile) => tile.zoom === 18)).toBe(true);
  const { tiles } = choose({ ...SYDNEY, longitude_deg: 179.9999 }, 0, 0, 0.4, ALL);
  const columns = tiles.filter((tile) => tile.zoom === 18).map((tile) => Number(addressOf(tile, "{x}")));
  expect(columns).toContain(2 ** 18 - 1);
  expect(columns).toContain(0);
  expect(Math.min(...columns)).toBe(0);
  expect(Math.max(...columns)).toBe(2 ** 18 - 1);
  expect(choose({ ...ZURICH, latitude_deg: 90 }, 0, 0, 0.4, ALL).tiles).toEqual([]);
  expect(choose({ ...ZURICH, latitude_deg: 85.0499 }, 0, 0, 4000, ALL).tiles.every((tile) => tile.row >= 0)).toBe(true);
});

test("an address is filled in wherever it names a number, more than once too", () => {
  const tile = { zoom: 3, column: -1, row: 2 };
  expect(addressOf(tile, "https://maps.example/{z}/{x}/{y}.png?again={z}")).toBe("https://maps.example/3/7/2.png?again=3");
});

test("few pictures are asked for at once, few are held, and what was dropped is let go", () => {
  const dropped: string[] = [];
  const tile_cache = new TileCache<string>((picture) => dropped.push(picture));
  const all = Array.from({ length: 100 }, (_, k) => `tile ${k}`);
  for (const first of [0, 36]) {
    const desired = all.slice(first, first + HELD_MAX);
    for (let round = 0; round < 30; round += 1) {
      const due = tile_cache.ask(desired, 0);
      expect(due.length).toBeLessThanOrEqual(4);
      expect(tile_cache.ask(desired, 0)).toEqual([]); // those are on their way
      for (const address of due) tile_cache.put(address, () => address);
      expect(tile_cache.size).toBeLessThanOrEqual(HELD_MAX);
    }
    expect(desired.every((address) => tile_cache.picture(address) === address)).toBe(true);
  }
  expect(dropped.sort()).toEqual(all.slice(0, 36).sort());
  tile_cache.clear();
  expect(dropped.length).toBe(100);
});

test("what could not be had is said, and asked for again a minute later, no sooner", () => {
  const tile_cache = new TileCache<string>(() => undefined);
  expect(tile_cache.ask(["a"], 1000)).toEqual(["a"]);
  tile_cache.fail("a", { reason: "cut", isMissing: false }, 2000);
  expect(tile_cache.failure("a")?.reason).toBe("cut");
  for (let now_ms = 2000; now_ms < 2000 + RETRY_MS; now_ms += 100) {
    expect(tile_cache.ask(["a"], now_ms)).toEqual([]);
  }
  expect(tile_cache.ask(["a"], 2000 + RETRY_MS)).toEqual(["a"]);
  tile_cache.put("a", () => "picture");
  expect([tile_cache.picture("a"), tile_cache.failure("a")]).toEqual(["picture", null]);
});

test("what left the picture and comes back is not asked for twice: neither on its way nor after a failure", () => {
  const tile_cache = new TileCache<string>(() => undefined);
  const others = (from: number): string[] => Array.from({ length: HELD_MAX }, (_, k) => `tile ${from + k}`);
  const visit = (desired: readonly string[]): string[] => {
    const all: string[] = [];
    for (let due = tile_cache.ask(desired, 0); due.length > 0; due = tile_cache.ask(desired, 0)) {
      for (const address of due) tile_cache.put(address, () => address);
      all.push(...due);
    }
    return all;
  };
  expect(tile_cache.ask(["slow", "broken"], 0)).toEqual(["slow", "broken"]);
  tile_cache.fail("broken", { reason: "cut", isMissing: false }, 0);
  expect(visit(others(0)).length).toBe(HELD_MAX); // the camera looks elsewhere
  expect(tile_cache.ask(["slow", "broken"], 1000)).toEqual([]);
  tile_cache.put("slow", () => "picture");
  expect([tile_cache.picture("slow"), tile_cache.failure("broken")?.reason]).toEqual(["picture", "cut"]);
});

test("a picture that comes when it is not wanted any more is not made", () => {
  const tile_cache = new TileCache<string>(() => undefined);
  tile_cache.ask(["a"], 0);
  tile_cache.clear();
  tile_cache.put("a", () => {
    throw new Error("made");
  });
  expect(tile_cache.picture("a")).toBeNull();
});

test("the token goes with tiles of this service, to no other, and no redirection is followed", () => {
  const page = "http://station:8000";
  const ours = requestFor("/api/v1/map/3/1/1", page, "secret");
  expect(ours.url).toBe("http://station:8000/api/v1/map/3/1/1");
  expect(ours.init.headers).toEqual({ Authorization: "Bearer secret" });
  for (const address of ["https://maps.example/3/1/1.png", "//maps.example/3/1/1.png", "http://station:8001/3/1/1", "/\\maps.example/3/1/1"]) {
    expect(JSON.stringify(requestFor(address, page, "secret"))).not.toContain("secret");
  }
  for (const address of ["/api/v1/map/3/1/1", "https://maps.example/3/1/1.png"]) {
    expect(requestFor(address, page, "").init).toMatchObject({ headers: {}, credentials: "omit", redirect: "error" });
  }
});
