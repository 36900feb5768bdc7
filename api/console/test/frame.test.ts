import { describe, expect, test } from "vitest";

import { decode, FrameError } from "../src/schemas/frame";
import { bytes, frame } from "./frames";
import { COLUMNS } from "./statuses";

describe("a frame", () => {
  test("is read as it was written", () => {
    const vehicles = [
      { x_m: 1, y_m: 2, height_m: 3, battery: 0.5, flags: 5 },
      { x_m: -4, phase: "lost" as const },
      { phase: "killed" as const },
    ];
    const code = { label: [1, 0, 2, 12] as const, behind_s: -0.25 };
    const read = frame({ ...code, time_s: 99.5, unix_time_s: 1_790_000_000.25, center_m: [7, 8, 9], radius_m: 12, vehicles }, 55);
    expect(read).toMatchObject({
      n: 3, revision: 7, time_s: 99.5, unix_time_s: 1_790_000_000.25, received_ms: 55, controlAlive: true,
      showPhase: "running", center_m: [7, 8, 9], target_m: [1.5, -2.5], radius_m: 12, minimumSeparation_m: 3.25,
      tick: { rate_hz: 20, count: 1234, missed: 3, p50_ms: 1, p99_ms: 2, lateness_p99_ms: 0.5 },
      setpointsSent: 4_000_000_000, interventions: 17, clock_s: 42.5, countdown_s: NaN,
      label: "01:00:02:12", behind_s: -0.25, tempo: 1,
    });
    expect([...read.x_m]).toEqual([1, -4, NaN]);
    expect([...read.height_m]).toEqual([3, NaN, NaN]);
    expect([...read.battery]).toEqual([0.5, NaN, NaN]);
    expect([...read.phase]).toEqual([4, 7, 9]);
    expect([...read.flags]).toEqual([5, 0, 0]);
  });

  test("without a formation has no centre, and an empty fleet is one", () => {
    expect(frame({})).toMatchObject({ n: 0, center_m: null, label: "", behind_s: NaN });
  });

  test.each([
    ["nothing", new ArrayBuffer(0), "0 bytes: the header alone has 128"],
    ["half a header", new ArrayBuffer(64), "64 bytes: the header alone has 128"],
    ["another version", bytes({ version: 3 }), "version 3: this page reads 4; load the page again"],
    ["too few bytes", bytes({ vehicles: [{}, {}] }).slice(0, 200), "200 bytes: with 2 vehicles it has 278"],
    ["too many bytes", new Uint8Array([...new Uint8Array(bytes({ vehicles: [{}] })), 0]).buffer, "204 bytes: with 1 vehicles it has 203"],
    ["a phase that is none", bytes({ showPhase: 11 }), "show phase 11: there are 11"],
  ])("is refused, and why: %s", (_name, buffer, why) => {
    expect(() => decode(buffer, 0, COLUMNS)).toThrowError(FrameError);
    expect(() => decode(buffer, 0, COLUMNS)).toThrowError(why);
  });
});
