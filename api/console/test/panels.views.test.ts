import { describe, expect, it } from "vitest";

import { help } from "../src/panels/help";
import { kill } from "../src/panels/kill";
import { previewText } from "../src/panels/preview";
import { command, type Press } from "../src/keys";
import { columns } from "../src/panels/plots";
import type { PanelActions } from "../src/panels/actions";
import { details, failures, preflightNow } from "../src/panels/preflight";
import { byReason, whyNotStart } from "../src/panels/start";
import { initial, type PreflightReport, type State } from "../src/state";
import { texts } from "../src/texts";
import { frame } from "./frames";
import { live, page } from "./pages";
import { press as pressed, textOf } from "./pressing";
import { GROUNDED, status } from "./statuses";

const press = (key: string, change: Partial<Press> = {}): Press => ({
  key, shift: false, other: false, typing: false, onControl: false, ...change,
});

describe("keys", () => {
  it("fly only with Shift, and never while somebody types", () => {
    expect(command(press("P", { shift: true }))).toEqual({ kind: "flight", action: "pause" });
    expect(command(press("L", { shift: true }))).toEqual({ kind: "flight", action: "abort" });
    for (const key of ["p", "l", "h", "k", "r"]) expect(command(press(key))).toBeNull();
    expect(command(press("L", { shift: true, typing: true }))).toBeNull();
    expect(command(press("L", { shift: true, other: true }))).toBeNull();
  });

  it("leave Enter and Space to the control that has the focus", () => {
    expect(command(press("Enter"))).toEqual({ kind: "confirm" });
    expect(command(press("Enter", { onControl: true }))).toBeNull();
    expect(command(press(" ", { onControl: true }))).toBeNull();
  });

  it("close with Escape wherever one is", () => {
    expect(command(press("Escape", { typing: true, onControl: true }))).toEqual({ kind: "close" });
  });

  it("leave the browser its own", () => {
    expect(command(press("F5"))).toBeNull();
    expect(command(press("r", { other: true }))).toBeNull();
  });
});

type Check = PreflightReport["fleet"][number];
const check = (name: string, change: Partial<Check> = {}): Check => ({
  name, state: "fail", value: 0.1, unit: "share", limit: "at least 0.25", problem: `${change.value ?? 0.1} left`, to_do: "charge it", depends_on: [], ...change,
});
type Cause = PreflightReport["causes"][number];
const cause = (text: string, change: Partial<Cause> = {}): Cause => ({
  check: "battery", state: "fail", text, to_do: "charge it", vehicles: [], follows: [], action: null, ...change,
});
const report = (checks: Readonly<Record<string, Check[]>>, out: readonly string[] = []): PreflightReport => ({
  passes: false, unix_time_s: 0, show: null, show_hash: null, fleet: [], not_flying: {}, not_checked: [], in_flight: "",
  causes: Object.entries(checks).flatMap(([id, all]) => (out.includes(id) ? [] : all.filter((each) => each.state !== "pass").map((each) => cause(`${id}: ${each.problem}`)))),
  vehicles: Object.entries(checks).map(([id, all]) => ({
    id, passes: all.every((each) => each.state === "pass"), flies: !out.includes(id), reason: "", checks: all, autopilot: "px4", version: "1.16.1",
  })),
});

describe("preflight", () => {
  const grounded = (): State => live({ frame: frame({}, 0), status: status({ show: { ...status().show, phase: "idle" }, counts: GROUNDED }) });

  it("shows the cause, what mends it, and folds what follows", () => {
    const action = { remedy: "leave-out" as const, label: "Leave d3 out", then: "ready", vehicles: ["d3"], radius_m: null, obstacle: "" };
    const found = { ...report({ d3: [check("fix")] }), causes: [cause("d3: fix 2D", { vehicles: ["d3"], follows: ["formation"], action })] };
    const mended: unknown[] = [];
    const view = details(grounded(), { mend: (each: unknown) => mended.push(each) } as unknown as PanelActions, found);
    for (const part of ["d3: fix 2D", "Leave d3 out", "then: ready", "1 check follows from it"]) expect(textOf(view)).toContain(part);
    pressed(view, "mend-0");
    expect(mended).toEqual([action]);
  });

  it("calls nothing passed where there is nothing", () => {
    expect(textOf(details(grounded(), {} as PanelActions, report({})))).not.toContain("preflight-passing");
  });

  it("tells of now alone: not in the air, and not for ever", () => {
    const show = (phase: "idle" | "running") => ({ ...initial(0), status: status({ show: { ...status().show, phase }, counts: phase === "idle" ? GROUNDED : status().counts }) });
    const read = (phase: "idle" | "running", age_ms: number) => {
      const state = show(phase);
      return { ...state, page_ms: 50_000, preflight: report({}), panels: { ...state.panels, preflightRead_ms: 50_000 - age_ms } };
    };
    expect(preflightNow(show("idle"))).toBeNull();
    expect(preflightNow(read("idle", 1000))).toEqual(report({}));
    expect(preflightNow(read("idle", 20_000))).toBeNull();
    expect(preflightNow(read("running", 1000))).toBeNull();
  });

  it("counts causes, and not what follows from them", () => {
    expect(failures({ ...report({ d1: [check("battery")] }), causes: [cause("a", { follows: ["b", "c"] }), cause("d")] })).toBe(2);
  });
});

describe("take off", () => {
  /** On the ground with a report that was read just now. */
  const ready = (found: PreflightReport | null, drafts: Record<string, string> = {}, panels: object = {}): State => {
    const state = live();
    const show = { ...status().show, phase: "idle" as const, possible: ["start" as const] };
    return {
      ...state, page_ms: 1000, frame: frame({ vehicles: [{ phase: "standby" }] }, 900),
      status: status({ show, counts: GROUNDED }), preflight: found, panels: { ...state.panels, drafts, preflightRead_ms: 900, ...panels },
    };
  };
  const good = { ...report({ d1: [check("battery", { state: "pass" })] }), passes: true };

  it("may be pressed when preflight passes, and not before it was read", () => {
    expect(whyNotStart(ready(good))).toBe("");
    expect(whyNotStart(ready(null))).toBe(texts.start.unknown);
  });

  it("may not be pressed while preflight fails, nor with no vehicle that flies", () => {
    expect(whyNotStart(ready(report({ d1: [check("battery")], d2: [check("clock")] })))).toBe("Take-off is blocked: 2 issues");
    expect(whyNotStart(ready({ ...good, passes: true, vehicles: [] }))).toBe(texts.start.noVehicles);
    const out = report({ d1: [check("battery")] }, ["d1"]);
    expect(whyNotStart(ready(out))).toBe(texts.start.noVehicles);
  });

  it("goes by the report for the vehicles that are named, not by the fleet's", () => {
    const named = { startNamed: true };
    expect(whyNotStart(ready(good, { "start-names": "d1 d2" }, named))).toBe(texts.start.unknown);
    expect(whyNotStart(ready(good, { "start-names": "d1 d2" }, { ...named, preflightFor: "d1 d2" }))).toBe("");
  });

  it("by the clock is not blocked by what may be mended until then", () => {
    expect(whyNotStart(ready(report({ d1: [check("battery")] }), { "start-time": "23:59" }, { startAt: true }))).toBe("");
  });

  it("tells the same reason of many once", () => {
    expect(byReason({ d1: "offline", d2: "excluded", d3: "offline" })).toEqual([
      { reason: "offline", vehicles: ["d1", "d3"] },
      { reason: "excluded", vehicles: ["d2"] },
    ]);
  });
});

describe("plots", () => {
  it("count from now, and leave gaps where nothing is known", () => {
    const history = { ...initial(0).history, time_s: Float64Array.of(5, 6, 8) };
    expect(columns(history, Float64Array.of(1, NaN, 3), 2)).toEqual([[-3, -2, 0], [1, null, 3], [2, 2, 2]]);
    expect(columns(history, Float64Array.of(1, NaN, 3), NaN)[2]).toEqual([null, null, null]);
  });
});

describe("sheets", () => {
  it("of a kill says how many vehicles it lists, and how many of them are chosen", () => {
    const { actions, state, dispatch } = page(live({ status: status(), frame: frame({ vehicles: [{}] }) }), () => undefined, "");
    expect(textOf(kill(state(), actions))).toContain(texts.kill.listed(0, 1));
    dispatch({ kind: "panels", change: { killNamed: new Set(["d1"]) } });
    expect(textOf(kill(state(), actions))).toContain("1 of the 1 vehicles listed here is chosen");
  });

  it("of help has nothing at its end that takes the focus, which would scroll it there", () => {
    expect(textOf(help(live()))).not.toContain("<button");
  });
});

describe("a ghost", () => {
  it("is told in numbers", () => {
    expect(previewText({ kind: "target", x_m: 3, y_m: -1.25 })).toBe("Target to x 3.0 m, y -1.3 m");
    expect(previewText({ kind: "radius", radius_m: 12 })).toBe("Radius 12.0 m");
  });
});
