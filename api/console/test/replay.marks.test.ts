import { expect, test } from "vitest";

import { span, ticks } from "../src/replay/marks";
import type { ReplayMarks } from "../src/state";

const NONE: ReplayMarks = { phases: [], cues: [], events: [], idle: [] };
const event = (at_s: number, severity: "info" | "warning" | "error", is_alarm = false, vehicle: string | null = null) => ({
  at_s, severity, is_alarm, text: `at ${at_s}`, vehicle,
});

test("a phase lies where it was, and stays within the record", () => {
  expect(span(30, 60, 120)).toEqual({ left: "25.000%", width: "25.000%" });
  expect(span(-5, 500, 120)).toEqual({ left: "0.000%", width: "100.000%" });
});

test("cues, alarms and warnings are marked where they happened, in order", () => {
  const found = ticks({ ...NONE, cues: [{ cue: "rise", at_s: 50 }], events: [event(80, "warning", false, "d2"), event(20, "error", true)] }, 100);
  expect(found.map(({ left, kind, text }) => [left, kind, text])).toEqual([
    ["20.000%", "alarm", "at 20"], ["50.000%", "cue", "rise"], ["80.000%", "warning", "d2: at 80"],
  ]);
});

test("marks that would lie on one another become one, the gravest, which tells of all", () => {
  const events = [event(50, "warning"), event(50.1, "error", true), ...Array.from({ length: 9 }, (_, k) => event(50.2 + k / 100, "warning" as const))];
  const found = ticks({ ...NONE, events }, 100);
  expect(found).toHaveLength(1);
  expect(found[0]!.kind).toBe("alarm");
  expect(found[0]!.text).toContain("at 50.1");
  expect(found[0]!.text).toContain("+ 5");
});
