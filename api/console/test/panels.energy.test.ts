import { expect, test } from "vitest";

import { entries, roughly } from "../src/panels/energy";
import { frame } from "./frames";

const IDS = ["d1", "d2", "d3"];
const reported = (written: Parameters<typeof frame>[0]): string[] => entries(frame(written), IDS).map(({ name, value }) => `${name}: ${value}`);

test("known values are shown, with the vehicle of the least battery", () => {
  const vehicles = [{ low_s: 400, empty_s: 700 }, {}, { low_s: 45.4, empty_s: 300 }];
  expect(reported({ vehicles, batteryLeast: 0.42, batteryLeastRow: 2, batteryMedian: 0.61, home_s: 44.6 })).toEqual([
    "Least battery: 42 % d3", "Median: 61 %", "Low in: ~45 s d3", "Home in: ~45 s",
  ]);
});

test("unknown values are left out, also for an unknown row", () => {
  expect(reported({ vehicles: [{}, {}, {}] })).toEqual([]);
  expect(reported({ vehicles: [{}, {}, {}], batteryLeast: 0.9, batteryLeastRow: 7 })).toEqual([]);
  expect(reported({ vehicles: [{}, {}, {}], assembled_s: 12.2 })).toEqual(["Assembled in: ~12 s"]);
});

test("an estimate does not look more exact than it is", () => {
  expect([0.2, 12.4, 89, 125, 599, 1500, NaN].map(roughly)).toEqual(["now", "~12 s", "~89 s", "~2:10 min", "~10:00 min", "~25 min", "not known"]);
});
