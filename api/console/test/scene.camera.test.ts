import { expect, test } from "vitest";

import type { Vec3 } from "../src/scene/axes";
import { facing, intoBox, nearestPlace, onLevel, placesWithin, project, rayThrough, type Screen } from "../src/scene/picking";
import { rectOf } from "../src/scene/selectionBox";
import { isDue, pixelRatio } from "../src/scene/renderer";
import { approach, basisOf, entered, framed, panned, START, turned, zoomed } from "../src/scene/rig";

const SCREEN: Screen = { width: 1440, height: 900, free: { left: 300, top: 60, width: 900, height: 700 } };

test("what is projected to a point of the screen lies on the ray through it", () => {
  const basis = basisOf(START);
  const place: Vec3 = [7, 3, -12];
  const seen = project(basis, START, SCREEN, place)!;
  const { from, along } = rayThrough(basis, START, SCREEN, seen.px, seen.py);
  const off = [place[0] - from[0], place[1] - from[1], place[2] - from[2]] as const;
  const far = off[0] * along[0] + off[1] * along[1] + off[2] * along[2];
  expect(Math.hypot(off[0] - far * along[0], off[1] - far * along[1], off[2] - far * along[2])).toBeLessThan(1e-9);
});

test("the focus is in the middle of what nothing lies over", () => {
  const seen = project(basisOf(START), START, SCREEN, START.focus)!;
  expect(seen.px).toBeCloseTo(750);
  expect(seen.py).toBeCloseTo(410);
});

test("a box selects the vehicles seen within it, whichever corner it began at, and none that has no place", () => {
  const basis = basisOf(START);
  const [x, y, z] = START.focus;
  const places = new Float32Array([x, y, z, 0, x + 30, y, z, 0, NaN, NaN, NaN, 0, x, y + 1, z, 0]);
  const rect = rectOf({ px: 790, py: 450 }, { px: 710, py: 370 });
  expect(placesWithin(basis, START, SCREEN, places, 4, rect)).toEqual([0, 3]);
  expect(placesWithin(basis, START, SCREEN, places, 4, { left: 0, top: 0, right: 1440, bottom: 900 })).toEqual([0, 1, 3]);
});

test("what is behind the camera is nowhere on the screen", () => {
  const basis = basisOf(START);
  const behind: Vec3 = [basis.eye[0] - basis.forward[0], basis.eye[1] - basis.forward[1], basis.eye[2] - basis.forward[2]];
  expect(project(basis, START, SCREEN, behind)).toBeNull();
});

test("a ray finds the ground, and nothing above the horizon", () => {
  const down = { from: [0, 10, 0], along: [0, -0.6, -0.8] } as const;
  expect(onLevel(down, 0)![2]).toBeCloseTo(-13.333);
  expect(onLevel({ from: [0, 10, 0], along: [0, 0.6, -0.8] }, 0)).toBeNull();
});

test("the place that faces the camera keeps its distance ahead", () => {
  const basis = basisOf(START);
  const place = facing(rayThrough(basis, START, SCREEN, 100, 800), basis.forward, START.focus);
  expect(project(basis, START, SCREEN, place)!.ahead_m).toBeCloseTo(project(basis, START, SCREEN, START.focus)!.ahead_m);
});

test("a box is met where it begins, missed beside it, and held from within", () => {
  const ray = { from: [0, 1, 10], along: [0, 0, -1] } as const;
  expect(intoBox(ray, [-1, 0, -1], [1, 2, 1])).toBeCloseTo(9);
  expect(intoBox(ray, [2, 0, -1], [4, 2, 1])).toBeNull();
  expect(intoBox(ray, [-20, 0, -20], [20, 20, 20])).toBe(0);
  expect(intoBox(ray, [-1, 0, 12], [1, 2, 14])).toBeNull(); // behind
});

test("the nearest vehicle is picked, those that are unknown or too far off are not", () => {
  const basis = basisOf(START);
  const place = new Float32Array([...START.focus, 0, START.focus[0] + 1, START.focus[1], START.focus[2], 0, NaN, NaN, NaN, 0]);
  expect(nearestPlace(basis, START, SCREEN, place, 3, 752, 411, 18)).toBe(0);
  expect(nearestPlace(basis, START, SCREEN, place, 3, 700, 200, 18)).toBe(-1);
});

test("all that is framed is seen, in every camera and shape of the screen, and nearly fills it", () => {
  const places: Vec3[] = [[-30, 0, 20], [35, 0, -10], [10, 60, 5], [0, 25, -40], [Number.NaN, 0, 0]];
  for (const camera of ["orbit", "top", "side", "follow"] as const) {
    for (const free of [{ left: 0, top: 0, width: 1440, height: 900 }, { left: 400, top: 50, width: 400, height: 800 }]) {
      const screen = { width: 1440, height: 900, free };
      const pose = framed(entered(camera, START, 0.3), places, screen);
      const seen = places.slice(0, 4).map((place) => project(basisOf(pose), pose, screen, place)!);
      const inX = seen.map(({ px }) => (px - free.left) / free.width);
      const inY = seen.map(({ py }) => (py - free.top) / free.height);
      expect(Math.min(...inX, ...inY)).toBeGreaterThan(0);
      expect(Math.max(...inX, ...inY)).toBeLessThan(1);
      expect(Math.max(Math.max(...inX) - Math.min(...inX), Math.max(...inY) - Math.min(...inY))).toBeGreaterThan(0.6);
    }
  }
});

test("the camera arrives: exactly, without passing its goal, the shorter way round", () => {
  const goal = { ...START, azimuth: START.azimuth + 1.9 * Math.PI, span_m: 20 };
  let pose = START;
  for (let k = 0; k < 120 && pose !== goal; k += 1) {
    const next = approach(pose, goal, 1 / 60);
    expect(next.span_m).toBeLessThanOrEqual(pose.span_m);
    expect(next.azimuth).toBeLessThanOrEqual(pose.azimuth + (next === goal ? 7 : 0));
    pose = next;
  }
  expect(pose).toBe(goal);
});

test("from above north is up; hands turn no farther than straight down, and not below the ground", () => {
  const top = entered("top", START, 0.7);
  expect(top.azimuth).toBe(0.7);
  expect(basisOf(top).forward[1]).toBeCloseTo(-1);
  expect(turned(START, 0, 9).elevation).toBeCloseTo(Math.PI / 2);
  expect(turned(START, 0, -9).elevation).toBeGreaterThan(0);
  expect(basisOf({ ...turned(START, 0, -9), focus: [0, 0, 0] }).eye[1]).toBeGreaterThan(0);
});

test("a pan moves over the ground, from the side up and down; a zoom has bounds", () => {
  expect(panned(START, 0.1, 0.2).focus[1]).toBe(START.focus[1]);
  expect(panned({ ...START, elevation: 0.05 }, 0, 0.2).focus[1]).toBeGreaterThan(START.focus[1]);
  expect(zoomed(START, 1e-9).span_m).toBeGreaterThan(0.5);
  expect(zoomed(START, 1e9).span_m).toBeLessThan(1e5);
});

test("a processor that paints gets fewer pixels where there are many vehicles, a graphics card what the screen has", () => {
  expect([8, 200].map((n) => pixelRatio(true, 2, n))).toEqual([1, 0.75]);
  expect([1, 2, 3].map((ofScreen) => pixelRatio(false, ofScreen, 1000))).toEqual([1, 2, 2]);
});

test("a processor that paints makes 30 pictures a second, a graphics card as many as the screen shows", () => {
  const drawn = (software: boolean): number => {
    let [count, last_ms] = [0, -Infinity];
    for (let now_ms = 0; now_ms < 1000; now_ms += 1000 / 60) {
      if (isDue(software, now_ms - last_ms)) [count, last_ms] = [count + 1, now_ms];
    }
    return count;
  };
  expect(drawn(true)).toBeLessThanOrEqual(31);
  expect(drawn(true)).toBeGreaterThanOrEqual(29);
  expect(drawn(false)).toBeGreaterThanOrEqual(60);
});

test("beside the fleet's grid a scene that holds the page up leaves it four times as long", () => {
  expect([300, 340].map((since_ms) => isDue(true, since_ms, 100))).toEqual([false, true]);
  expect([30, 40].map((since_ms) => isDue(true, since_ms, 1000 / 60))).toEqual([true, true]); // one that holds up nothing
  expect(isDue(false, 0, 100)).toBe(true);
});
