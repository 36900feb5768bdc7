import { expect, it } from "vitest";

import { verdict } from "../src/replay/report";

it("shows three verdicts, and only what was judged from beginning to end in green", () => {
  expect(verdict({ verdict: "kept" }).kind).toBe("good");
  expect(verdict({ verdict: "broken" }).kind).toBe("bad");
  expect(verdict({ verdict: "incomplete" })).toMatchObject({ kind: "unsure", mark: "warning" });
});
