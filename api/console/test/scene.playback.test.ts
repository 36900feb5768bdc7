import { expect, test } from "vitest";

import { CARRIED_ON_MS, Playback, Poses } from "../src/scene/playback";
import type { Frame } from "../src/state";
import { frame } from "./frames";

/** One vehicle that flies ahead at 5 m/s; frame k arrives `jitter` late. */
function flight(k: number, jitter_ms = 0, change: Partial<Frame> = {}): Frame {
  const one = frame({ time_s: 10 + 0.1 * k, vehicles: [{ x_m: 0.5 * k, y_m: 0, height_m: 20 }] }, 1000 + 100 * k + jitter_ms);
  one.vx_m_s[0] = 5;
  one.vy_m_s[0] = 0;
  one.vup_m_s[0] = 0;
  one.heading_deg[0] = 0;
  return { ...one, ...change };
}

function shown(playback: Playback, now_ms: number): number {
  const poses = new Poses();
  poses.set(playback.at(now_ms)!, 0);
  return -poses.place[2]!; // the show's x
}

test("nothing is shown before the first frame, and the first as it is", () => {
  const playback = new Playback();
  expect(playback.at(0)).toBeNull();
  playback.push(flight(4));
  expect(shown(playback, 1400)).toBeCloseTo(2);
  expect(playback.at(5000)!.still).toBe(true);
});

test("between two frames the way is even, whatever the network's jitter", () => {
  const playback = new Playback();
  const seen: number[] = [];
  for (let k = 0; k < 30; k += 1) {
    const late_ms = [0, 18, -12, 25, -5][k % 5]!;
    const arrives_ms = 1000 + 100 * k + late_ms;
    for (let now_ms = 1000 + 100 * (k - 1) + [0, 18, -12, 25, -5][(k + 4) % 5]!; now_ms < arrives_ms && k > 10; now_ms += 16) {
      seen.push(shown(playback, now_ms));
    }
    playback.push(flight(k, late_ms));
  }
  const steps = seen.slice(1).map((each, k) => each - seen[k]!);
  expect(Math.min(...steps)).toBeGreaterThan(-0.06); // never noticeably backwards: 5 m/s is 0.08 m in a picture
  expect(Math.max(...steps)).toBeLessThan(0.2);
});

test("what is late is carried on for a moment, then it stands: old data never looks alive", () => {
  const playback = new Playback();
  for (let k = 0; k <= 20; k += 1) {
    playback.push(flight(k));
  }
  const last_m = 10; // of the newest frame
  const until_m = last_m + (5 * CARRIED_ON_MS) / 1000;
  expect(shown(playback, 3000 + 110 + 100)).toBeCloseTo(last_m + 0.5, 1);
  expect(playback.at(3000 + 110 + 100)!.still).toBe(false);
  expect(shown(playback, 4000)).toBeCloseTo(until_m, 2);
  expect(shown(playback, 60_000)).toBeCloseTo(until_m, 2);
  expect(playback.at(4000)!.still).toBe(true);
});

test("a replay that stands still extrapolates no vehicle", () => {
  const playback = new Playback();
  playback.push(flight(0));
  playback.push(flight(1));
  playback.push(flight(1, 100));
  expect(shown(playback, 1500)).toBeCloseTo(0.5);
});

test("a leap back in a replay, or another fleet, begins anew without a way in between", () => {
  const playback = new Playback();
  playback.push(flight(50));
  playback.push(flight(51));
  playback.push(flight(3, 4900));
  expect(shown(playback, 6201)).toBeCloseTo(1.5);
  const two = frame({ time_s: 11, vehicles: [{ x_m: 1 }, { x_m: 2 }] }, 6300);
  playback.push(two);
  expect(playback.at(6301)!.to).toBe(two);
  expect(playback.at(6301)!.from).toBe(two);
});

test("a heading turns the shorter way, an unknown place stays unknown, and a jump is not flown", () => {
  const before = flight(0, 0);
  const after = flight(1, 0);
  before.heading_deg[0] = 350;
  after.heading_deg[0] = 10;
  after.x_m[0] = 400;
  const poses = new Poses();
  poses.set({ from: before, to: after, share: 0.5, beyond_s: 0, still: false, run: 0 }, 0);
  expect(Math.cos(poses.place[3]!)).toBeCloseTo(1); // north
  expect(-poses.place[2]!).toBeCloseTo(400);
  after.x_m[0] = Number.NaN;
  poses.set({ from: before, to: after, share: 0.5, beyond_s: 0, still: false, run: 0 }, 0);
  expect(poses.known(0)).toBe(false);
});
