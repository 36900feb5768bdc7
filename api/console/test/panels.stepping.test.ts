import { describe, expect, it } from "vitest";

import type { PreflightReport, ShowPhase, State } from "../src/state";
import type { Message } from "../src/update";
import { frame } from "./frames";
import { after } from "./pages";
import { GROUNDED, status } from "./statuses";

const report = (passes: boolean): PreflightReport => ({
  passes, unix_time_s: 0, show: null, show_hash: null, fleet: [], not_flying: {}, not_checked: [], causes: [], in_flight: "", vehicles: [],
});

const phase = (name: ShowPhase, change: Parameters<typeof status>[0] = {}): Message =>
  ({ kind: "status", status: status({ ...change, show: { ...status().show, phase: name } }) });

const onGround = (): State => after([phase("idle", { counts: GROUNDED }), { kind: "frame", frame: frame({}, 100) }, { kind: "tick", now_ms: 100 }]);

describe("the preflight panel", () => {
  it("makes room at take-off, and may be opened in flight", () => {
    const state = after([phase("arming")], onGround());
    expect(state.panels.left).toBeNull();
    const opened = after([{ kind: "panels", change: { left: "preflight" } }, phase("running")], state);
    expect(opened.panels.left).toBe("preflight");
  });

  it("leaves another panel as it is at take-off", () => {
    expect(after([{ kind: "panels", change: { left: "shape" } }, phase("arming")], onGround()).panels.left).toBe("shape");
  });

  it("opens when preflight fails while a start is prepared, and not when it passes", () => {
    const starting = after([{ kind: "panels", change: { left: null, sheet: "start" } }], onGround());
    expect(after([{ kind: "preflight", report: report(true) }], starting).panels.left).toBeNull();
    expect(after([{ kind: "preflight", report: report(false) }], starting).panels.left).toBe("preflight");
    expect(after([{ kind: "preflight", report: report(false) }, { kind: "panels", change: { left: null } }], onGround()).panels.left).toBeNull();
  });

  it("does not open in a replay", () => {
    const replay = { file: "f", began_unix_time_s: 0, duration_s: 9, position_s: 0, speed: 1, paused: false, ended: false };
    expect(after([phase("idle", { replay } as Parameters<typeof status>[0])]).panels.left).toBeNull();
  });
});
