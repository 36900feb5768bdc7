import { expect, test } from "vitest";

import { closePairs } from "../src/scene/proximity";
import { isStale, Appearance, FORMS, MARK } from "../src/scene/appearance";
import { sceneForm } from "../src/panels/icons";
import { DAY, NIGHT } from "../src/scene/palette";
import { Table } from "../src/scene/instances";
import { Playback, Poses } from "../src/scene/playback";
import { fenceNearness } from "../src/scene/scenery";
import { Ring, slotsFor } from "../src/scene/trails";
import { FLAG, PHASES, type Frame } from "../src/state";
import { frame, type Vehicle } from "./frames";
import { textOf } from "./pressing";

const FLOOR = { horizontal_m: 2, vertical_m: 3, pad_height_m: 2 };
const at = (x_m: number, y_m: number, height_m: number, more: Vehicle = {}): Vehicle => ({ x_m, y_m, height_m, ...more });

test("pairs are close in the ellipsoid's metric: nearer sideways than one above the other", () => {
  const beside = closePairs(frame({ vehicles: [at(0, 0, 20), at(2, 0, 20)] }), FLOOR);
  const above = closePairs(frame({ vehicles: [at(0, 0, 20), at(0, 0, 23)] }), FLOOR);
  expect(beside[0]!.proximity).toBeCloseTo(1);
  expect(above[0]!.proximity).toBeCloseTo(1);
  expect(beside[0]!.distance_m).toBeCloseTo(2);
  expect(above[0]!.distance_m).toBeCloseTo(3);
  expect(closePairs(frame({ vehicles: [at(0, 0, 20), at(3.2, 0, 20)] }), FLOOR)).toEqual([]);
});

test("the closest pairs come first, none is missed or told twice", () => {
  const vehicles = Array.from({ length: 60 }, (_, i) => at(((i * 7919) % 100) / 5, ((i * 104729) % 100) / 5, 20 + (i % 3)));
  const pairs = closePairs(frame({ vehicles }), FLOOR, 10_000);
  const expected = vehicles.flatMap((a, i) => vehicles.slice(i + 1).filter((b) =>
    Math.hypot(a.x_m! - b.x_m!, a.y_m! - b.y_m!, (a.height_m! - b.height_m!) * (2 / 3)) < 3).map(() => i)).length;
  expect(expected).toBeGreaterThan(20);
  expect(pairs.length).toBe(expected);
  expect(new Set(pairs.map(({ first, second }) => `${Math.min(first, second)} ${Math.max(first, second)}`)).size).toBe(expected);
  expect(pairs.map(({ proximity }) => proximity)).toEqual(pairs.map(({ proximity }) => proximity).sort((a, b) => a - b));
});

test("who stands on the ground, is unknown, or lower than the pads' height has no other close to it", () => {
  const near = [at(0, 0, 20), at(1, 0, 20, { phase: "standby" }), { x_m: 1 }];
  expect(closePairs(frame({ vehicles: near }), FLOOR)).toEqual([]);
  expect(closePairs(frame({ vehicles: [at(0, 0, 1), at(1, 0, 1.5)] }), FLOOR)).toEqual([]);
  expect(closePairs(frame({ vehicles: [at(0, 0, 1), at(1, 0, 2.5)] }), FLOOR)).toHaveLength(1);
});

function looked(one: Frame, { isFresh = true, selected = [] as number[], palette = NIGHT } = {}): Appearance {
  one.position_age_s.forEach((age, i) => (one.position_age_s[i] = Number.isNaN(age) ? 0 : age));
  const appearance = new Appearance();
  appearance.set(one, palette, isFresh, new Set(selected));
  return appearance;
}

const tintOf = (appearance: Appearance, i: number): number[] => [...appearance.tints.subarray(4 * i, 4 * i + 3)].map((each) => Math.round(each * 255));

test("a vehicle with a light has the light's colour, others their phase's", () => {
  const one = frame({ vehicles: [at(0, 0, 20, { flags: FLAG.lit }), at(9, 0, 20, { phase: "landing" })] });
  [one.red[0], one.green[0], one.blue[0]] = [255, 128, 0];
  const appearance = looked(one);
  expect(tintOf(appearance, 0)).toEqual([255, 128, 0]);
  expect(tintOf(appearance, 1)).toEqual(NIGHT.phase.landing.map((each) => Math.round(each * 255)));
  expect(appearance.tints[3]).toBe(1);
});

test("a light that is off does not shine, but the vehicle is still seen", () => {
  const appearance = looked(frame({ vehicles: [at(0, 0, 20, { flags: FLAG.lit })] }));
  expect(appearance.tints[3]).toBe(0);
  expect(tintOf(appearance, 0)[0]).toBeGreaterThan(50);
});

test("what is old is grey and does not shine, be it one vehicle or the whole connection", () => {
  const one = frame({ vehicles: [at(0, 0, 20, { flags: FLAG.lit }), at(9, 0, 20, { flags: FLAG.lit | FLAG.limited })] });
  one.red.fill(255);
  one.position_age_s.set([1.2, 0.1]);
  expect([0, 1].map((i) => isStale(one, i, true))).toEqual([true, false]);
  const grey = NIGHT.stale.map((each) => Math.round(each * 255));
  expect(tintOf(looked(one), 0)).toEqual(grey);
  expect(tintOf(looked(one), 1)).toEqual([255, 0, 0]);
  const lost = looked(one, { isFresh: false });
  expect(tintOf(lost, 1)).toEqual(grey);
  expect(lost.tints[7]).toBe(0);
  expect(lost.marks[1]).toBe(0); // it is not known whether it is limited now
  one.position_age_s[1] = Number.NaN;
  expect(isStale(one, 1, true)).toBe(true);
});

test("limited and selected are marked by shape", () => {
  const vehicles = [at(0, 0, 20, { flags: FLAG.limited }), at(9, 0, 20, { phase: "lost" }), at(18, 0, 20), at(27, 0, 20)];
  expect([...looked(frame({ vehicles }), { selected: [2, 3] }).marks]).toEqual([MARK.limited, 0, MARK.selected, MARK.selected]);
});

test("each phase has a form of its own, told to the shader by its number, and shown in the help", () => {
  expect([...FORMS].sort()).toEqual([...PHASES].sort());
  const one = frame({ vehicles: FORMS.map((phase, i) => at(5 * i, 0, 20, { phase })) });
  const forms = new Appearance();
  forms.set(one, NIGHT, true, new Set());
  expect([...forms.forms]).toEqual(FORMS.map((_, i) => i));
  expect(new Set(PHASES.map((phase) => textOf(sceneForm(phase)))).size).toBe(PHASES.length);
});

test("no two phases look alike, night and day", () => {
  for (const palette of [NIGHT, DAY]) {
    const colors = PHASES.map((phase) => palette.phase[phase]);
    for (const [k, a] of colors.entries()) {
      for (const b of colors.slice(k + 1)) {
        expect(Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2])).toBeGreaterThan(0.12);
      }
    }
  }
});

/** Fly a ring of trails; returns it, and how many segments are drawn as the shader would. */
function flown(places: readonly (readonly [number, number, number])[]): { ring: Ring; drawn: () => number } {
  const ring = new Ring(1);
  const poses = new Poses();
  places.forEach(([x_m, y_m, height_m], k) => {
    const one = frame({ vehicles: [at(x_m, y_m, height_m)] });
    poses.set({ from: one, to: one, share: 1, beyond_s: 0, still: false, run: 0 }, 0);
    ring.write(poses, new Float32Array(4), (k + 1) * 1.01 * ring.every_s);
  });
  const numbers = (slot: number, column: number): number => ring.rows[slot * 8 + column]!;
  const drawn = (): number => {
    let count = 0;
    for (let slot = 0; slot < ring.slots; slot += 1) {
      const isAlive = numbers(slot, 7) === 1 && numbers(slot + 1, 7) === 1;
      count += isAlive && numbers(slot + 1, 3) > numbers(slot, 3) ? 1 : 0;
    }
    return count;
  };
  return { ring, drawn };
}

test("a trail joins its samples one after another, also past the ring's seam", () => {
  const way = (n: number): [number, number, number][] => Array.from({ length: n }, (_, k) => [k, 0, 20]);
  expect(flown(way(10)).drawn()).toBe(9);
  const { ring, drawn } = flown(way(250));
  expect(drawn()).toBe(ring.slots - 1);
});

test("a trail is cleared by a jump, and by not knowing where", () => {
  expect(flown([[0, 0, 20], [1, 0, 20], [900, 0, 20]]).drawn()).toBe(0);
  expect(flown([[0, 0, 20], [1, 0, 20], [900, 0, 20], [901, 0, 20]]).drawn()).toBe(1);
  expect(flown([[0, 0, 20], [1, 0, 20], [Number.NaN, 0, 20], [2, 0, 20]]).drawn()).toBe(0);
});

test("the larger the fleet, the shorter its trails, and never more in all than can be drawn", () => {
  expect(slotsFor(8)).toBeGreaterThan(slotsFor(200));
  expect(slotsFor(200)).toBeGreaterThan(slotsFor(1000));
  expect(1000 * slotsFor(1000)).toBeLessThan(20_000);
  expect(slotsFor(0)).toBeGreaterThan(0);
});

test("after a scrub no trail joins the vehicles' old and new places", () => {
  const playback = new Playback();
  const poses = new Poses();
  const show = (k: number, unix_time_s: number, x_m: number): void => {
    playback.push(frame({ time_s: 100 + 0.1 * k, unix_time_s, vehicles: [at(x_m, 0, 20)] }, 1000 + 100 * k));
    poses.set(playback.at(1000 + 100 * k)!, 0);
  };
  show(0, 5000, 0);
  show(1, 5000.1, 0.5);
  const ring = new Ring(1, new Table(2), poses.run);
  expect(ring.joins(poses)).toBe(true);
  show(2, 5361, 12); // six minutes on, 12 m away: a leap that the distance alone does not tell
  expect(ring.joins(poses)).toBe(false);
  expect(-poses.place[2]!).toBe(12); // and no vehicle slides there
  const anew = new Ring(1, new Table(2), poses.run);
  show(3, 5361.1, 12.5);
  expect(anew.joins(poses)).toBe(true);
  show(4, 5360, 12); // back by a second
  expect(anew.joins(poses)).toBe(false);
});

test("a replay at ten times its speed is no scrub", () => {
  const playback = new Playback();
  const runs = Array.from({ length: 20 }, (_, k) => {
    playback.push(frame({ time_s: 100 + 0.1 * k, unix_time_s: 5000 + k, vehicles: [at(k, 0, 20)] }, 1000 + 100 * k));
    return playback.at(1000 + 100 * k)!.run;
  });
  expect(new Set(runs).size).toBe(1);
});

test("the fence is seen when a vehicle comes near it, sideways or up", () => {
  const fence = { height_min_m: 3, height_max_m: 100, distance_max_m: 300 };
  const near = (...vehicles: Vehicle[]): number => fenceNearness(frame({ vehicles }), fence);
  expect(near(at(0, 0, 20), at(100, 50, 40))).toBe(0);
  expect(near(at(0, 0, 20), at(280, 0, 20))).toBeCloseTo(0.5);
  expect(near(at(0, 0, 95))).toBe(1);
  expect(near(at(400, 0, 20))).toBe(1); // beyond it
  expect(near(at(NaN, 0, 20))).toBe(0);
});
