import { describe, expect, it } from "vitest";

import type { Alarm } from "../src/alarms/model";
import { autopilots, fleet } from "../src/panels/fleet";
import { rowIds } from "../src/panels/fleetGrid";
import { group } from "../src/panels/group";
import { parseQuery, toggled } from "../src/panels/query";
import { sorted, windowed, type Row } from "../src/panels/rows";
import type { State } from "../src/state";
import { frame } from "./frames";
import { after, live, page } from "./pages";
import { press, textOf } from "./pressing";
import { status } from "./statuses";

const row = (id: string, change: Partial<Row> = {}): Row => ({
  index: 0, id, phase: "formation", mode: "offboard", height_m: 20, battery: 0.8, age_s: 0.1, link: 0.99, fixIsBad: false, fix: "3D", fix_m: 0.4,
  nearest_m: 8, armed: true, ready: false, limited: false, limitedBy: "", station: "", autopilot: "px4", received: true, alarm: "normal", ...change,
});
const ids = (rows: readonly Row[]): string[] => rows.map((each) => each.id);

describe("the filter", () => {
  const rows = [
    row("d1", { battery: 0.25 }),
    row("d2", { phase: "hold", limited: true }),
    row("d10", { age_s: 1.4, fix: "RTK" }),
    row("x3", { phase: "lost", age_s: NaN, nearest_m: NaN }),
  ];
  const found = (text: string): string[] => ids(rows.filter(parseQuery(text).test));

  it("needs every term", () => {
    expect(found("")).toEqual(["d1", "d2", "d10", "x3"]);
    expect(found("phase:hold,lost")).toEqual(["d2", "x3"]);
    expect(found("phase:hold,lost limited")).toEqual(["d2"]);
    expect(found("battery<30")).toEqual(["d1"]);
    expect(found("fix:rtk age>1")).toEqual(["d10"]);
    expect(found("-limited d")).toEqual(["d1", "d10"]);
    expect(found("station:north")).toEqual([]);
    expect(ids([row("d1"), row("d2", { autopilot: "ardupilot" })].filter(parseQuery("autopilot:ArduPilot").test))).toEqual(["d2"]);
    expect(ids([row("d1", { station: "North" }), row("d2", { station: "south" })].filter(parseQuery("station:North,west").test))).toEqual(["d1"]);
  });

  it("calls a position old that is not known", () => {
    expect(found("stale")).toEqual(["d10", "x3"]);
    expect(found("age:unknown")).toEqual(["x3"]);
  });

  it("says what is wrong, and goes by the rest", () => {
    expect(parseQuery("batery<30").problem).toContain("batery");
    expect(parseQuery("battery<").problem).toContain("battery<");
    expect(parseQuery("colour:red").problem).toContain("phase");
    expect(found("colour:red phase:hold")).toEqual(["d2"]);
    expect(parseQuery("phase:hold battery<30").problem).toBe("");
  });

  it("takes a range of the numbers at the end of ids", () => {
    expect(found("2-10")).toEqual(["d2", "d10", "x3"]);
    expect(found("2-10 d")).toEqual(["d2", "d10"]);
    expect(ids([row("left"), row("d1")].filter(parseQuery("0-9").test))).toEqual(["d1"]);
  });

  it("finds what has a problem, by whichever sign", () => {
    expect(found("problem")).toEqual(["d1", "d10", "x3"]);
    const alarmed = [row("a", { alarm: "caution" }), row("b", { alarm: "information" }), row("c", { fixIsBad: true }), row("d", { phase: "killed" }), row("e")];
    expect(ids(alarmed.filter(parseQuery("problem").test))).toEqual(["a", "c", "d"]);
    expect(ids(alarmed.filter(parseQuery("alarm").test))).toEqual(["a", "b"]);
  });

  it("is a line that chips write into", () => {
    expect(toggled("d1", "limited")).toBe("d1 limited");
    expect(toggled("d1  limited", "limited")).toBe("d1");
  });
});

const alarm = (id: string, severity: Alarm["severity"], vehicles: string[], ended_unix_time_s: number | null = null): Alarm => ({
  id, severity, vehicles, ended_unix_time_s, cause: "poor-link", text: "", advice: "", raised_unix_time_s: 1, since_unix_time_s: 1,
  acknowledged_by: null, acknowledged_unix_time_s: null, command_id: null, action: null, reasons: [],
});

/** So many vehicles in formation; the second one has a low battery and two alarms. */
function flying(n: number): State {
  const names = Array.from({ length: n }, (_, i) => ({ ...status().vehicles[0]!, id: `d${i + 1}` }));
  const alarms = [alarm("a", "caution", ["d2"]), alarm("b", "warning", ["d2"]), alarm("c", "emergency", ["d1"], 5)];
  const one = frame({ vehicles: names.map((_, i) => ({ phase: i === 1 ? ("hold" as const) : ("formation" as const), battery: i === 1 ? 0.12 : 0.87 })) }, 2000);
  one.position_age_s.fill(0.1);
  return after([{ kind: "status", status: status({ vehicles: names, alarms }) }, { kind: "frame", frame: one }], live({ page_ms: 2000 }));
}

describe("the grid", () => {
  it("has a pill for each vehicle: phase, battery, fix and its worst alarm that lasts, as form and as words", () => {
    const { actions, state } = page({ ...flying(3), panels: { ...flying(3).panels, grid: true } }, () => undefined, "");
    const text = textOf(fleet(state(), actions));
    expect(text.match(/role="option"/g)).toHaveLength(3);
    expect(text).toContain("form-hold b1 alarm-warning low");
    expect(text).toContain("d2, hold, battery 12 %, fix 3D, alarm: warning");
    expect(text).toContain("form-formation b9 alarm-normal");
    expect(text).not.toContain("<table");
  });

  it("selects what was typed: a range, and what has a problem", () => {
    const { actions, state } = page(flying(250), () => undefined, "");
    actions.filter("100-200");
    press(fleet(state(), actions), "filter-select");
    expect(state().view.selection).toHaveLength(101);
    expect([state().view.selection[0], state().view.selected]).toEqual(["d100", "d200"]);
    actions.filter("problem");
    press(fleet(state(), actions), "filter", "keydown", {}, "Enter");
    expect(state().view.selection).toEqual(["d2"]);
  });

  it("selects a thousand within a fifth of a second, with all that is written of them", () => {
    const { actions, state } = page(flying(1000), () => undefined, "");
    actions.set({ grid: true });
    actions.openPanel("vehicle");
    const began = process.cpuUsage(); // of this process alone: other ones do not count
    actions.choose({ how: "only", ids: rowIds(state()) });
    const texts = [textOf(fleet(state(), actions)), textOf(group(state(), actions))];
    expect(process.cpuUsage(began).user / 1000).toBeLessThan(200);
    expect(texts[0]).toContain("1000 vehicles selected");
    expect(texts[1]).toContain("and 900 more");
  });
});

describe("the order", () => {
  it("counts as people do", () => {
    expect(ids(sorted([row("d10"), row("d9"), row("d1")], { column: "id", descending: false }))).toEqual(["d1", "d9", "d10"]);
  });

  it("puts what is not known last, whichever way", () => {
    const rows = [row("a", { nearest_m: NaN }), row("b", { nearest_m: 3 }), row("c", { nearest_m: 5 })];
    expect(ids(sorted(rows, { column: "nearest", descending: false }))).toEqual(["b", "c", "a"]);
    expect(ids(sorted(rows, { column: "nearest", descending: true }))).toEqual(["c", "b", "a"]);
  });
});

describe("the order by station", () => {
  it("has the vehicles of a station in their own order", () => {
    const rows = [row("d10", { station: "b" }), row("d9", { station: "b" }), row("d1", { station: "c" }), row("d2", { station: "a" })];
    expect(ids(sorted(rows, { column: "station", descending: false }))).toEqual(["d2", "d9", "d10", "d1"]);
    expect(ids(sorted(rows, { column: "station", descending: true }))).toEqual(["d1", "d9", "d10", "d2"]);
  });
});

describe("the autopilots", () => {
  it("are counted where there are several", () => {
    const one = status().vehicles[0]!;
    const fleet = (names: string[]) => autopilots(status({ vehicles: names.map((autopilot) => ({ ...one, autopilot })) }));
    expect(fleet(["px4", "px4"])).toEqual([]);
    expect(fleet(["px4", "ardupilot", "px4"])).toEqual([["ardupilot", 1], ["px4", 2]]);
  });
});

describe("the rows that are drawn", () => {
  it("are those on the screen and a few more, and the others keep their room", () => {
    const shown = windowed(1000, 18_000, 720, 36);
    expect(shown.last - shown.first).toBeLessThan(40);
    expect(shown.first).toBeLessThanOrEqual(500);
    expect(shown.last).toBeGreaterThanOrEqual(520);
    expect(shown.above_px + (shown.last - shown.first) * 36 + shown.below_px).toBe(36_000);
  });

  it("are the last ones where the list has become shorter than where somebody had scrolled to", () => {
    expect(windowed(10, 18_000, 180, 36)).toMatchObject({ first: 0, last: 10, below_px: 0 });
    expect(windowed(0, 500, 180, 36)).toMatchObject({ first: 0, last: 0, above_px: 0 });
  });
});
