import { expect, test } from "vitest";

import { north_rad, roundStep, shortest_rad, toScene, toShow, turn_rad } from "../src/scene/axes";
import { stepsFor } from "../src/scene/grid";
import { basisOf, START } from "../src/scene/rig";

test("three's axes are the show's y, the height, and minus the show's x; and back", () => {
  expect(toScene(1, 2, 3)).toEqual([2, 3, -1]);
  expect(toShow(toScene(1, 2, 3))).toEqual({ x_m: 1, y_m: 2, height_m: 3 });
});

test("a model that looks along -z looks where its heading points, in a show frame that is turned", () => {
  const looksAlong = (turn: number): { x: number; y: number } => ({ x: Math.cos(turn), y: -Math.sin(turn) }); // show frame
  expect(looksAlong(turn_rad(90, 0)).y).toBeCloseTo(1); // east is to the right of north
  expect(looksAlong(turn_rad(30, 30)).x).toBeCloseTo(1); // along the show's own heading
  expect(looksAlong(turn_rad(120, 30)).y).toBeCloseTo(1);
});

test("the camera's azimuth is clockwise from the show's x, so that north is at the top with north's", () => {
  const { forward } = basisOf({ ...START, elevation: 0, azimuth: north_rad(90) });
  expect(toShow(forward).y_m).toBeCloseTo(-1); // the show looks east: north is to its left
});

test("turns are compared the shorter way", () => {
  expect(shortest_rad(1.9 * Math.PI)).toBeCloseTo(-0.1 * Math.PI);
  expect(shortest_rad(-7 * Math.PI + 0.2)).toBeCloseTo(-Math.PI + 0.2);
});

test("numbers on the ground are round, and the finer lines divide them into round parts", () => {
  expect([0.3, 1, 1.1, 4, 60, 700].map(roundStep)).toEqual([0.5, 1, 2, 5, 100, 1000]);
  for (const span_m of [3, 17, 80, 333, 2400]) {
    const { step_m, parts } = stepsFor(span_m, 900);
    expect((step_m * 900) / span_m).toBeGreaterThanOrEqual(115); // room for the number
    expect((step_m * 900) / span_m).toBeLessThan(300);
    expect(roundStep(step_m / parts)).toBeCloseTo(step_m / parts);
  }
});
