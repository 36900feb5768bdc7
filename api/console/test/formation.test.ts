import { expect, test } from "vitest";

import { energy, nearest_m, radiusError_m } from "../src/formation";
import { frame } from "./frames";

const center_m = [10, 20, 30] as const;
const at = (x: number, y: number, z: number) => ({ x_m: 10 + x, y_m: 20 + y, height_m: 30 + z });

test("the radius error is that of whoever in the formation is farthest off the sphere", () => {
  const vehicles = [at(10, 0, 0), at(0, -8.5, 0), at(0, 0, 10.5), { ...at(0, 0, 90), phase: "hold" as const }, {}];
  expect(radiusError_m(frame({ center_m, radius_m: 10, vehicles }))).toBeCloseTo(1.5);
});

test("without a formation there is no error and no energy", () => {
  const vehicles = [at(10, 0, 0), at(-10, 0, 0)];
  expect(radiusError_m(frame({ vehicles }))).toBeNaN();
  expect(energy(frame({ vehicles }))).toBeNaN();
  const grounded = vehicles.map((each) => ({ ...each, phase: "standby" as const }));
  expect(radiusError_m(frame({ center_m, vehicles: grounded }))).toBeNaN();
  expect(energy(frame({ center_m, vehicles: vehicles.slice(1) }))).toBeNaN();
});

test("the energy is least where the shape is evenest, whatever its size", () => {
  const opposite = frame({ center_m, vehicles: [at(10, 0, 0), at(-10, 0, 0)] });
  const tetrahedron = [at(5, 5, 5), at(5, -5, -5), at(-5, 5, -5), at(-5, -5, 5)];
  const even = energy(frame({ center_m, vehicles: tetrahedron }));
  const uneven = energy(frame({ center_m, vehicles: [at(5, 5, 4), ...tetrahedron.slice(1)] }));
  expect(energy(opposite)).toBeCloseTo(0.5);
  expect(even).toBeCloseTo(3.674234614 / 6, 6); // Thomson's, four charges
  expect(uneven).toBeGreaterThan(even);
});

test("the nearest is told for each who is somewhere", () => {
  const nearest = nearest_m(frame({ vehicles: [at(0, 0, 0), at(3, 4, 0), {}, at(3, 4, 2)] }));
  expect([...nearest]).toEqual([5, 2, NaN, 2]);
  expect([...nearest_m(frame({ vehicles: [at(0, 0, 0)] }))]).toEqual([NaN]);
});
