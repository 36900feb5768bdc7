import { expect, it } from "vitest";

import { autopilots, verdict } from "../src/replay/report";

it("shows three verdicts, and only what was judged from beginning to end in green", () => {
  expect(verdict({ verdict: "kept" }).kind).toBe("good");
  expect(verdict({ verdict: "broken" }).kind).toBe("bad");
  expect(verdict({ verdict: "incomplete" })).toMatchObject({ kind: "unsure", mark: "warning" });
});

it("names the autopilots that flew, where the record does", () => {
  expect(autopilots({ autopilots: { ardupilot: 1, px4: 3 } })).toBe(" (1 ardupilot, 3 px4)");
  expect(autopilots({ autopilots: {} })).toBe("");
});
