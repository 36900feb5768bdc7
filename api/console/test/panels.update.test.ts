import { describe, expect, it } from "vitest";

import { doomed } from "../src/panels/kill";
import { whyNoStart, whyNot, whyNotOnGround, whyNotShape, whyNotShow, whyNotVehicle } from "../src/panels/rights";
import { lastOrder, whyNotSelection } from "../src/panels/group";
import { isOutdated, refusal } from "../src/panels/shows";
import { startOrder } from "../src/panels/start";
import { life, showReason } from "../src/panels/topbar";
import { typedNumbers } from "../src/panels/shape";
import type { Right, State } from "../src/state";
import { texts } from "../src/texts";
import type { Message } from "../src/update";
import { position_s } from "../src/replay/bar";
import { frame, type Vehicle } from "./frames";
import { access, after } from "./pages";
import { GROUNDED, command, status } from "./statuses";

const FLEET: readonly Vehicle[] = [{ phase: "formation", battery: 0.9 }, { phase: "offline" }, { phase: "hold", battery: 0.2, flags: 4 }];

const names = ["d1", "d2", "d10"].map((id, i) => ({ ...status().vehicles[0]!, id, system_id: i + 1 }));

function flying(rights: readonly Right[] = ["watch", "emergency", "operate"], change: Parameters<typeof status>[0] = {}): State {
  return after([
    { kind: "access", access: access(rights) },
    { kind: "status", status: status({ vehicles: names, ...change }) },
    { kind: "frame", frame: frame({ vehicles: FLEET }, 100) },
  ]);
}

const STALE: Message = { kind: "tick", now_ms: 1200 };

describe("who may press what", () => {
  it("lets a watcher press nothing, and says so", () => {
    const state = flying(["watch"]);
    for (const action of ["pause", "stop", "abort", "kill", "start", "obstacle"]) expect(whyNot(state, action)).toBe(texts.flight.watcher);
  });

  it("lets an emergency token bring the fleet down, and nothing else", () => {
    const state = flying(["watch", "emergency"]);
    expect([whyNotShow(state, "pause"), whyNotShow(state, "stop"), whyNot(state, "kill")]).toEqual(["", "", ""]);
    expect(whyNotShow(state, "resume")).toBe(texts.flight.notOperate);
    expect(whyNotVehicle(state, "join", "hold")).toBe(texts.flight.notOperate);
    expect(whyNotVehicle(state, "land", "hold")).toBe("");
  });

  it("goes by what the show can do now, and names the phase", () => {
    expect(whyNotShow(flying(), "resume")).toContain(texts.phases.running);
    expect(whyNotShow(flying(), "pause")).toBe("");
  });

  it("still tries what brings the fleet down when the data is old, for the service may know better", () => {
    const state = after([STALE], flying(undefined, { show: { ...status().show, phase: "idle", possible: ["start"] } }));
    expect([whyNotShow(state, "stop"), whyNotShow(state, "abort"), whyNot(state, "kill")]).toEqual(["", "", ""]);
    expect([whyNotShow(state, "start"), whyNot(state, "obstacle")]).toEqual([texts.flight.noData, texts.flight.noData]);
  });

  it("orders nothing in a replay, nor before it is known who asks", () => {
    const replay = { file: "f", began_unix_time_s: 0, duration_s: 9, position_s: 0, speed: 1, paused: false, ended: false, skips_idle: true };
    expect(whyNot(flying(undefined, { replay }), "abort")).toBe(texts.flight.replay);
    expect(whyNot(after([{ kind: "access", access: null }], flying()), "abort")).toBe(texts.flight.noRights);
  });

  it("keeps pause, return and land whenever anything is airborne, in whatever phase, and start out of reach", () => {
    for (const phase of ["idle", "landed", "uncontrolled", "aborting"] as const) {
      const state = flying(undefined, { show: { ...status().show, phase, possible: ["start"] } });
      expect(["pause", "stop", "abort"].map((action) => whyNotShow(state, action as "pause"))).toEqual(["", "", ""]);
      expect(whyNotShow(state, "start")).toBe("Unavailable: 2 airborne");
    }
    const down = flying(undefined, { show: { ...status().show, phase: "idle", possible: ["start"] }, counts: GROUNDED });
    expect([whyNotShow(down, "start"), whyNotShow(down, "stop")]).toEqual(["", "Unavailable while idle"]);
  });

  it("opens the start while it would be refused, for its sheet says why, and marks the button", () => {
    const show = { ...status().show, phase: "idle" as const, possible: [], start_refused: "checklist pads: 1 of 2 items are open" };
    const refused = flying(undefined, { show, counts: GROUNDED });
    expect([whyNotShow(refused, "start"), whyNoStart(refused)]).toEqual(["", show.start_refused]);
    expect(whyNoStart(flying(undefined, { show: { ...show, phase: "running" } }))).toBe("");
  });

  it("says how many fly without this station's control, whatever the reason's words are", () => {
    const counts = { ...status().counts, airborne: 14, controlled: 0, uncontrolled: 14 };
    const state = flying(undefined, { show: { ...status().show, phase: "uncontrolled", reason: "long words" }, counts });
    expect(showReason(state)).toBe("14 airborne");
  });

  it("leaves to a selected show what it decides, also while it is paused; a live cue takes the target", () => {
    const selected = {
      name: "parade", hash: "ab", cue: "stand", cues: ["stand"], clock_s: 1, duration_s: 9, runs: false, spares: [], begun: true, target_is_live: false,
    };
    const led = (change: object): State => flying(undefined, { show: { ...status().show, selected: { ...selected, ...change } } });
    for (const change of [{}, { runs: true }]) {
      for (const what of ["formation", "orbit", "target"] as const) expect(whyNotShape(led(change), what)).toBe(texts.shape.led("parade"));
    }
    const live = led({ target_is_live: true });
    expect([whyNotShape(live, "target"), whyNotShape(live, "formation")]).toEqual(["", texts.shape.led("parade")]);
    expect(whyNotShape(flying(), "formation")).toBe("");
  });

  it("settles on the ground what belongs there", () => {
    expect(whyNotOnGround(flying())).toContain(texts.phases.running);
    expect(whyNotOnGround(flying(undefined, { show: { ...status().show, phase: "landed" }, counts: GROUNDED }))).toBe("");
    expect(whyNotOnGround(flying(undefined, { show: { ...status().show, phase: "landed" } }))).toContain("2 airborne");
  });
});

describe("what the connection is called", () => {
  const replay = { file: "f", began_unix_time_s: 0, duration_s: 9, position_s: 9, speed: 1, paused: false, ended: true, skips_idle: true };
  const stated = (controlAlive: boolean, change: Parameters<typeof status>[0]): string => life(after([
    { kind: "connection", connection: { kind: "live", reason: "", since_ms: 0 } },
    { kind: "frame", frame: frame({ vehicles: FLEET, controlAlive }, 100) },
  ], flying(undefined, change)));

  it("never says of a replay that control stopped: there is none", () => {
    expect([stated(true, { replay }), stated(false, { replay })]).toEqual(["replay", "stale"]);
    expect([stated(true, {}), stated(false, {})]).toEqual(["live", "dead"]);
  });
});

describe("the fleet table", () => {
  it("is in order as soon as there is something to put in order", () => {
    const { table } = flying().panels;
    expect(table.command).toEqual([0, 1, 2]);
    expect(table.phases).toMatchObject({ formation: 1, offline: 1, hold: 1, lost: 0 });
  });

  it("follows the filter and the sorting at once, but telemetry once a second", () => {
    const filtered = after([{ kind: "panels", change: { filter: "phase:hold" } }], flying());
    expect(filtered.panels.table.command).toEqual([2]);
    const moved = frame({ vehicles: [{ phase: "hold" }, { phase: "hold" }, { phase: "hold" }] }, 600);
    const soon = after([{ kind: "frame", frame: moved }], filtered);
    expect(soon.panels.table.command).toEqual([2]);
    const later = after([{ kind: "frame", frame: { ...moved, received_ms: 1200 } }], soon);
    expect(later.panels.table.command).toEqual([0, 1, 2]);
    const byBattery = after([{ kind: "panels", change: { sort: { column: "battery", descending: false } } }], flying());
    expect(byBattery.panels.table.command).toEqual([2, 0, 1]);
  });
});

describe("what is typed", () => {
  it("stays until it is undone, field by field", () => {
    const typed = after(
      [
        { kind: "draft", field: "formation:radius_m", text: "12" },
        { kind: "draft", field: "formation:height_m", text: "2x" },
        { kind: "draft", field: "orbit:radius_m", text: "5" },
        { kind: "status", status: status({ formation: { radius_m: 8, height_m: 9, law: "slots", radius_now_m: 8, height_now_m: 9 } }) },
      ],
      flying(),
    );
    expect(typedNumbers(typed.panels.drafts, "formation")).toBeNull();
    expect(typedNumbers(typed.panels.drafts, "orbit")).toEqual({ radius_m: 5 });
    const undone = after([{ kind: "undo", prefix: "formation:" }], typed);
    expect(undone.panels.drafts).toEqual({ "orbit:radius_m": "5" });
  });

  it("makes a start, or says what is missing", () => {
    const base = flying();
    expect(startOrder(base)).toEqual({ vehicles: null, at_unix_time_s: null });
    const named = after([{ kind: "panels", change: { startNamed: true } }], base);
    expect(startOrder(named)).toBe(texts.start.badNames);
    expect(startOrder(after([{ kind: "draft", field: "start-names", text: "d1, d2 d1" }], named))).toEqual({
      vehicles: ["d1", "d2"],
      at_unix_time_s: null,
    });
    const timed = after([{ kind: "panels", change: { startAt: true } }, { kind: "draft", field: "start-time", text: "25:00" }], base);
    expect(startOrder(timed)).toBe(texts.start.badTime);
  });

  it("is closed with the obstacle that it was for", () => {
    const box = { id: "tower", x_m: 0, y_m: 0, half_length_x_m: 1, half_length_y_m: 1, height_m: 5, velocity_x_m_s: 0, velocity_y_m_s: 0 };
    const editing = after(
      [
        { kind: "status", status: status({ obstacles: [box] }) },
        { kind: "panels", change: { editing: "tower" } },
        { kind: "draft", field: "obstacle:x_m", text: "4" },
      ],
      flying(),
    );
    expect(after([{ kind: "status", status: status({ obstacles: [box] }) }], editing).panels.editing).toBe("tower");
    const gone = after([{ kind: "status", status: status({ obstacles: [] }) }], editing);
    expect([gone.panels.editing, gone.panels.drafts]).toEqual([null, {}]);
  });
});

describe("commands to the selection", () => {
  const selecting = (...ids: string[]): State => after([{ kind: "select", choice: { how: "only", ids } }], flying());

  it("are refused without a selection, and where they can reach none of it", () => {
    expect(whyNotSelection(flying(), "hold")).toBe(texts.selection.none);
    expect(whyNotSelection(selecting("d2"), "hold")).toContain("offline");
    expect(whyNotSelection(selecting("d1", "d2"), "hold")).toBe("");
    expect(whyNotSelection(selecting("d10"), "join")).toBe("");
    expect(whyNotSelection(selecting("d1", "d2"), "take-control")).toBe("Unavailable while formation, offline");
  });

  it("show what became of each vehicle: the newest command that named it", () => {
    const part = { outcome: "done", reason: "" } as const;
    const state = after(
      [
        { kind: "command", command: { ...command("o1"), action: "hold", outcomes: { d1: part, d2: part } } },
        { kind: "command", command: { ...command("o2"), action: "join", outcomes: { d2: part } } },
      ],
      selecting("d1", "d2"),
    );
    expect(["d1", "d2", "d10"].map((id) => lastOrder(state, id)?.action)).toEqual(["hold", "join", undefined]);
  });
});

describe("a show that Select refused", () => {
  const check = (hash: string) => ({ name: "parade", state: "done", good: true, hash, problems: [], figures: null, reason: "" }) as never;
  const refused = after(
    [
      { kind: "check", check: check("a1") },
      { kind: "show-selected", name: "parade", hash: "a1", problem: "takeoff_stagger_s is 1, the service's is 0.3" },
    ],
    flying(),
  );

  it("is no longer called good, and says why, also when the same file is checked again", () => {
    expect(refusal(refused, "parade")).toContain("takeoff_stagger_s");
    expect(refusal(after([{ kind: "check", check: check("a1") }], refused), "parade")).toContain("takeoff_stagger_s");
    expect(refusal(refused, "other")).toBe("");
  });

  it("is good again once it was selected, or has changed", () => {
    expect(refusal(after([{ kind: "show-selected", name: "parade", hash: "a1", problem: "" }], refused), "parade")).toBe("");
    expect(refusal(after([{ kind: "check", check: check("b2") }], refused), "parade")).toBe("");
  });
});

describe("a selected show", () => {
  const selected = { name: "parade", hash: "a1", cue: "", cues: [], clock_s: 0, duration_s: 9, begun: false, runs: false, spares: [], target_is_live: false };
  const state = flying(undefined, { show: { ...status().show, selected } });
  const checked = (hash: string | null): State =>
    after([{ kind: "check", check: { name: "parade", state: "done", good: true, fits_service: true, hash, problems: [], reason: "", figures: null } }], state);

  it("is out of date once the file was checked with another hash, by this page or another", () => {
    expect(isOutdated(checked("b2"), { name: "parade", hash: null })).toBe(true);
    expect(isOutdated(state, { name: "parade", hash: "b2" })).toBe(true);
  });

  it("is as it was selected, or not known to be another", () => {
    expect([checked("a1"), checked(null), state].map((each) => isOutdated(each, { name: "parade", hash: null }))).toEqual([false, false, false]);
    expect(isOutdated(state, { name: "other", hash: "b2" })).toBe(false);
  });
});

describe("refusals", () => {
  it("are kept after their toasts have gone, the newest first", () => {
    const state = after([{ kind: "refused", text: "one" }, { kind: "refused", text: "two" }, { kind: "tick", now_ms: 1e6 }], flying());
    expect(state.toasts).toEqual([]);
    expect(state.panels.refusals.map((each) => each.text)).toEqual(["two", "one"]);
  });
});

describe("the kill", () => {
  it("begins with no vehicle; names all that are not offline only on demand, or those chosen", () => {
    expect(doomed(flying())).toEqual([]);
    expect(doomed(after([{ kind: "panels", change: { killNamed: null } }], flying()))).toEqual(["d1", "d10"]);
    expect(doomed(after([{ kind: "panels", change: { killNamed: new Set(["d2"]) } }], flying()))).toEqual(["d2"]);
  });

  it("begins with the selection, whatever was chosen the last time, and keeps what is chosen while it is open", () => {
    const open: Message = { kind: "panels", change: { sheet: "kill" } };
    const selecting: Message = { kind: "select", choice: { how: "only", ids: ["d2", "d10"] } };
    const before = after([{ kind: "panels", change: { killNamed: null } }, selecting, open], flying());
    expect(doomed(before)).toEqual(["d2", "d10"]);
    const chosen = after([{ kind: "panels", change: { killNamed: new Set(["d1"]) } }, open], before);
    expect(doomed(chosen)).toEqual(["d1"]);
    expect(doomed(after([{ kind: "panels", change: { sheet: null } }, { kind: "select", choice: { how: "only", ids: [] } }, open], chosen))).toEqual([]);
  });

  it("is not held any more once its code is too old", () => {
    const armed = after(
      [{ kind: "kill-armed", armed: { code: "a1b2c3", vehicles: ["d1"], valid_s: 20 } }, { kind: "panels", change: { holding_ms: 100 } }],
      flying(),
    );
    expect(after([{ kind: "tick", now_ms: 20_099 }], armed).panels.holding_ms).toBe(100);
    const over = after([{ kind: "tick", now_ms: 20_101 }], armed);
    expect([over.kill, over.panels.holding_ms]).toEqual([null, null]);
  });
});

describe("a replay", () => {
  it("is where its newest frame was recorded", () => {
    const replay = { file: "f", began_unix_time_s: 1_790_000_000 - 30, duration_s: 60, position_s: 2, speed: 1, paused: false, ended: false, skips_idle: true };
    expect(position_s(flying(undefined, { replay }))).toBeCloseTo(30.25);
    expect(position_s(flying(undefined, { replay: { ...replay, duration_s: 10 } }))).toBe(10);
    expect(position_s(flying())).toBe(0);
  });
});
