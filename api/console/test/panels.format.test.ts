import { describe, expect, it } from "vitest";

import { fixed, measured, minutes, nextClockTime, parsed, percent, plain, seconds, tail, withUnit } from "../src/panels/format";

describe("numbers for an operator", () => {
  it("says what is not known with a dash, never with a zero", () => {
    for (const unknown of [NaN, null, undefined, Infinity]) {
      expect([fixed(unknown), withUnit(unknown, "m"), percent(unknown), seconds(unknown), minutes(unknown), plain(unknown)]).toEqual(
        Array(6).fill("–"),
      );
    }
  });

  it("never rounds a battery up", () => {
    expect(percent(0.199)).toBe("19 %");
    expect(percent(0.29)).toBe("29 %"); // 0.29 * 100 is 28.999999999999996
    expect(percent(1)).toBe("100 %");
  });

  it("shortens a long name to its end, which differs from those of others", () => {
    expect([tail("d1", 8), tail("vehicle8", 8), tail("vehicle-of-the-north-017", 8)]).toEqual(["d1", "vehicle8", "…rth-017"]);
  });

  it("shows no minus before a zero", () => {
    expect(fixed(-0.04)).toBe("0.0");
    expect(fixed(-0.06)).toBe("-0.1");
  });

  it("writes times as they are read", () => {
    expect([minutes(75.9), minutes(-5.2), minutes(3725), minutes(-0.4)]).toEqual(["1:15", "−0:05", "1:02:05", "0:00"]);
    expect([seconds(0.31), seconds(31.4), seconds(125)]).toEqual(["0.3 s", "31 s", "2:05"]);
  });

  it("writes a number by its unit", () => {
    expect([measured(0.5, "share"), measured(31.4, "s"), measured(3, "m/s"), measured(NaN, "s")]).toEqual(["50 %", "31 s", "3.0 m/s", "–"]);
  });
});

describe("what somebody types", () => {
  it("takes a comma for a point, and nothing that is no number", () => {
    expect(["12", " 12,5 ", "-.5", "+3.", "−4"].map(parsed)).toEqual([12, 12.5, -0.5, 3, -4]);
    expect(["", "1e3", "12 m", "0x10", "1,2,3", "NaN", "Infinity", "-"].map(parsed)).toEqual(Array(8).fill(null));
  });

  it("takes a clock time as the next one to come", () => {
    const noon_s = new Date(2026, 5, 1, 12, 0, 0).getTime() / 1000;
    expect(nextClockTime("12:30", noon_s)).toBe(noon_s + 1800);
    expect(nextClockTime("12:00:01", noon_s)).toBe(noon_s + 1);
    expect(nextClockTime("11:59", noon_s)).toBe(noon_s + 86_400 - 60);
    for (const wrong of ["24:00", "12:60", "noon", "12", "12:30:99"]) expect(nextClockTime(wrong, noon_s)).toBeNull();
  });
});
