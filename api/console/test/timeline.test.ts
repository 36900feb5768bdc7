import { describe, expect, it } from "vitest";

import { decoded } from "../src/drawn/model";
import { replayBar } from "../src/replay/bar";
import type { FlightMarks, SelectedShow, ShowPhase, State } from "../src/state";
import { cut, drawnCourse, flightCourse, marksOf, recordCourse, type Course } from "../src/timeline/model";
import { openMark, timeline } from "../src/timeline/strip";
import { frame, type Written } from "./frames";
import { live, page } from "./pages";
import { press, textOf } from "./pressing";
import { GROUNDED, status } from "./statuses";

const BEGAN = 1_790_000_000;
const MARKS: FlightMarks = { began_unix_time_s: BEGAN, phases: [], cues: [], commands: [], events: [], idle: [] };
const CUES = [{ cue: "rise", at_s: 0 }, { cue: "ring", at_s: 40 }];
const SHOW: SelectedShow = {
  name: "parade", hash: "ab", cue: "rise", cues: ["rise", "ring"], clock_s: 0, duration_s: 100, runs: false, target_is_live: false, begun: false, spares: [], lit_until_s: 120,
};
const event = (at_s: number, alarm_severity: FlightMarks["events"][number]["alarm_severity"], change: Partial<FlightMarks["events"][number]> = {}) => ({
  at_s, severity: "warning" as const, alarm: alarm_severity === null ? null : `a${at_s}`, alarm_severity, text: `at ${at_s}`, vehicle: null, ...change,
});
const order = (at_s: number) => ({ at_s, action: "hold", text: "command hold by anna", vehicle: "d1" });
const phases = (...all: readonly (readonly [ShowPhase, number, number])[]) => all.map(([phase, from_s, until_s]) => ({ phase, from_s, until_s }));

/** `now_s` into a flight with these marks; frames of tests say that the show's clock is at 42.5 s. */
function flying(phase: ShowPhase, now_s: number, marks: Partial<FlightMarks>, selected: SelectedShow | null = SHOW, written: Written = {}): State {
  const ground = phase === "idle" || phase === "landed";
  return live({
    status: status({ show: { ...status().show, phase, selected }, timeline: CUES, ...(ground ? { counts: GROUNDED } : {}) }),
    frame: frame({ unix_time_s: BEGAN + now_s, ...written }),
    marks: { ...MARKS, ...marks },
  });
}

const partsOf = ({ parts }: Course) => parts.map((each) => [each.cue ?? each.phase, each.from_s, each.until_s]);

describe("marks", () => {
  it("lie where it happened, each with its vehicle and as grave as it is", () => {
    const found = marksOf({ ...MARKS, events: [event(80, null, { vehicle: "d2" }), event(20, "emergency"), event(50, null, { severity: "error" })] }, 100, 300);
    expect(found.map(({ at_s, kind, text, alarm }) => [at_s, kind, text, alarm])).toEqual([
      [20, "emergency", "at 20", "a20"], [50, "error", "at 50", null], [80, "notice", "d2: at 80", null],
    ]);
  });

  it("nearer than a finger is wide become one: the gravest, where that is, which tells of all", () => {
    const crowd = { ...MARKS, commands: [order(46)], events: [event(50, "caution"), event(52, "warning"), event(57, null)] };
    const [only, ...others] = marksOf(crowd, 100, 300);
    expect(others).toEqual([]);
    expect(only).toMatchObject({ at_s: 52, kind: "warning", alarm: "a52", isCommanded: true });
    expect(only!.text).toBe("at 52; 0:50 at 50; 0:57 at 57; 0:46 d1: command hold by anna");
    const nine = Array.from({ length: 9 }, (_, k) => event(50 + k / 100, null));
    expect(marksOf({ ...MARKS, events: nine }, 100, 300).map(({ text }) => text.split("; ").at(-1))).toEqual(["+ 3"]);
  });

  it("lie at least 24 pixels from one another, the more of them the wider the course is", () => {
    const kinds = ["warning", null, "caution", null, "emergency"] as const;
    const events = Array.from({ length: 50 }, (_, k) => event(2.1 * k, kinds[k % kinds.length]!)); // the last are after the end
    const [small, large] = [300, 1200].map((width_px) => {
      const at_px = marksOf({ ...MARKS, commands: [order(3)], events }, 100, width_px).map(({ at_s }) => Math.min(at_s / 100, 1) * width_px);
      for (const [k, next] of at_px.slice(1).entries()) expect(next - at_px[k]!).toBeGreaterThanOrEqual(24);
      return at_px.length;
    });
    expect([small, large].map((count) => count! > 5)).toEqual([true, true]);
    expect(large).toBeGreaterThan(small!);
  });

  it("of commands alone stay commands, apart from what happened elsewhere", () => {
    const found = marksOf({ ...MARKS, commands: [order(20)], events: [event(50, "caution")] }, 100, 300);
    expect(found.map(({ kind, isCommanded }) => [kind, isCommanded])).toEqual([["command", true], ["caution", false]]);
  });
});

describe("a course", () => {
  it("has each cue from when it was flown, in what runs alone", () => {
    const spans = phases(["arming", 0, 20], ["running", 20, 60], ["paused", 60, 70], ["running", 70, 90]).map((each) => ({ ...each, isGuess: false }));
    const parts = cut(spans, [{ cue: "rise", at_s: 0 }, { cue: "ring", at_s: 50 }]);
    expect(parts.map(({ cue, phase, from_s, until_s }) => [cue ?? phase, from_s, until_s])).toEqual([
      ["arming", 0, 20], ["rise", 20, 50], ["ring", 50, 60], ["paused", 60, 70], ["ring", 70, 90],
    ]);
  });

  it("has no cue of the flight before: the show may have been deselected since", () => {
    const flights = phases(["idle", 0, 5], ["running", 5, 20], ["landed", 20, 30], ["running", 30, 50]);
    const record = recordCourse({ ...MARKS, phases: flights, cues: [{ cue: "drawn", at_s: 5 }] }, 40, 60);
    expect(partsOf(record)).toEqual([["idle", 0, 5], ["drawn", 5, 20], ["landed", 20, 30], ["running", 30, 50]]);
  });

  it("of a show on the ground is its cues, between a take-off and a return of unknown length", () => {
    const found = flightCourse(flying("idle", 0, { began_unix_time_s: null }))!;
    expect(partsOf(found)).toEqual([["arming", 0, 8], ["rise", 8, 48], ["ring", 48, 108], ["returning", 108, 116]]);
    expect(found.parts.map((each) => each.isGuess)).toEqual([true, false, false, true]);
    expect(found.lit).toEqual({ from_s: 8, until_s: 116 });
  });

  it("of a show in the air has what was flown, and what is ahead as it is estimated", () => {
    const assembling = flying("assembling", 30, { phases: phases(["arming", 0, 20], ["assembling", 20, 29]) }, SHOW, { assembled_s: 9.5 });
    expect(partsOf(flightCourse({ ...assembling, frame: { ...assembling.frame!, clock_s: 0 } })!)).toEqual([
      ["arming", 0, 20], ["assembling", 20, 40], ["rise", 40, 80], ["ring", 80, 140], ["returning", 140, 148],
    ]);
    const running = flightCourse(flying("running", 75, { phases: phases(["arming", 0, 30], ["running", 30, 74]) }, SHOW, { home_s: 21.5 }))!;
    expect(partsOf(running)).toEqual([["arming", 0, 30], ["rise", 30, 72.5], ["ring", 72.5, 132.5], ["returning", 132.5, 154.5]]);
    expect([running.now_s, running.duration_s, running.lit]).toEqual([75, 155, { from_s: 32.5, until_s: 152.5 }]);
  });

  it("has the time of a pause in the cue that was paused", () => {
    const { parts } = flightCourse(flying("running", 95, { phases: phases(["arming", 0, 30], ["running", 30, 60], ["paused", 60, 80], ["running", 80, 94]) }))!;
    expect(parts.map(({ cue, phase, from_s, until_s }) => [cue ?? phase, from_s, until_s])).toEqual([
      ["arming", 0, 30], ["rise", 30, 60], ["paused", 60, 80], ["rise", 80, 92.5], ["ring", 92.5, 152.5], ["returning", 152.5, 160.5],
    ]);
  });

  it("on the way home ends what was not played, and lights with it", () => {
    const found = flightCourse(flying("returning", 80, { phases: phases(["running", 0, 70], ["returning", 70, 79]) }, SHOW, { home_s: 12 }))!;
    expect(partsOf(found)).toEqual([["rise", 0, 67.5], ["ring", 67.5, 70], ["returning", 70, 92]]);
    expect(found.lit!.until_s).toBe(70);
  });

  it("without a show grows minute by minute, so that marks stay where they are", () => {
    const at = (now_s: number) => flightCourse(flying("running", now_s, { phases: phases(["arming", 0, 20], ["running", 20, 25]) }, null))!;
    expect([at(30), at(80), at(100)].map((each) => each.duration_s)).toEqual([120, 120, 180]);
    expect(partsOf(at(80))).toEqual([["arming", 0, 20], ["running", 20, 80]]);
  });

  it("of the last flight stays until the plan is asked for, and there is none before the first", () => {
    const landed = flying("landed", 500, { phases: phases(["running", 0, 70], ["returning", 70, 92]), events: [event(90, "warning")] });
    const flown = { ...landed, marks: { ...landed.marks!, phases: [...landed.marks!.phases, ...phases(["landed", 92, 92])] } };
    expect(flightCourse(flown)).toMatchObject({ now_s: 92, duration_s: 92, marks: { events: [{ alarm: "a90" }] } });
    expect(flightCourse({ ...flown, panels: { ...flown.panels, plan: true } })!.parts[1]!.cue).toBe("rise");
    expect(flightCourse(flying("idle", 0, { began_unix_time_s: null }, null))).toBeNull();
    expect(flightCourse(flying("arming", 3, flown.marks, null)), "marks of the flight before").toBeNull();
  });

  it("of a drawing is its cues, and of a record what was recorded", () => {
    const drawing = decoded({ show: "s", vehicles: [], duration_s: 70, from_s: 0, rate_hz: 1, positions_m: [], colours: [], cues: [{ cue: "wall", at_s: 0 }, { cue: "back", at_s: 55 }] });
    expect(partsOf(drawnCourse(drawing, 60))).toEqual([["wall", 0, 55], ["back", 55, 70]]);
    const record = recordCourse({ ...MARKS, phases: phases(["idle", 0, 10], ["running", 10, 60]), cues: [{ cue: "rise", at_s: 12 }] }, 30, 60);
    expect(partsOf(record)).toEqual([["idle", 0, 10], ["running", 10, 12], ["rise", 12, 60]]);
    expect(recordCourse(null, 30, 60).parts).toEqual([]);
  });
});

describe("the timeline", () => {
  const strip = (state: State) => textOf(timeline(state, page(state, () => undefined, "").actions));
  const running = (panels: object = {}): State => {
    const state = flying("running", 75, { phases: phases(["arming", 0, 30], ["running", 30, 74]) }, { ...SHOW, runs: true }, { home_s: 21.5 });
    return { ...state, panels: { ...state.panels, ...panels } };
  };

  it("says where the show is, what is left, and when all are down", () => {
    for (const part of ["parade", "ring", "0:42 / 1:40", "0:58 left, down in ~1:19"]) expect(strip(running())).toContain(part);
  });

  it("is one line on a phone, which opens", () => {
    expect(strip(running({ layout: "sheet" }))).not.toContain('data-testid="course"');
    expect(strip(running({ layout: "sheet", timeline: true }))).toContain('data-testid="course"');
  });

  it("begins the show at a cue of the plan that is pressed", () => {
    const { actions, calls, state } = page(flying("idle", 0, { began_unix_time_s: null }), () => ({}), "");
    press(timeline(state(), actions), "cue-ring");
    expect(calls.map(({ call, body }) => [call, body])).toEqual([["POST /api/v1/show/seek", { cue: "ring" }]]);
  });

  it("opens the log or the commands from a mark whose alarm is no longer listed", () => {
    const { actions, state } = page(running(), () => undefined, "");
    openMark(actions, { at_s: 1, kind: "command", text: "", alarm: null, isCommanded: true });
    expect(state().panels).toMatchObject({ right: "events", eventList: "commands" });
    openMark(actions, { at_s: 1, kind: "warning", text: "", alarm: "gone", isCommanded: false });
    expect(state().panels.eventList).toBe("lines");
  });
});

describe("in a replay the timeline", () => {
  const replay = { file: "a.mcap", began_unix_time_s: BEGAN, duration_s: 60, position_s: 0, speed: 1, paused: true, ended: false, skips_idle: false };
  const replaying = () => {
    const marks = { ...MARKS, phases: phases(["running", 0, 60]), events: [event(20, "warning")] };
    return page(live({ status: status({ replay }), frame: frame({ unix_time_s: BEGAN + 30 }), marks }), () => replay, "");
  };

  it("seeks where it is dragged to, by keys, and at a mark", async () => {
    const { actions, calls, state } = replaying();
    const bar = () => replayBar(state(), actions);
    press(bar(), "replay-scrubber", "input", { value: "12.5" });
    expect(calls, "not while it is dragged").toEqual([]);
    expect(textOf(bar())).toContain("0:12 of 1:00");
    press(bar(), "replay-scrubber", "change", { value: "12.5" });
    press(bar(), "replay-scrubber", "keydown", { value: "58" }, "ArrowRight");
    expect(textOf(bar()), "no width, no marks").not.toContain("mark-warning");
    actions.set({ course_px: 600 });
    press(bar(), "mark-warning");
    expect(calls.map(({ body }) => body)).toEqual([{ position_s: 12.5 }, { position_s: 60 }, { position_s: 20 }]);
  });
});
