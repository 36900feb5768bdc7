import { describe, expect, it } from "vitest";

import { iconOf, REPEATED_MS, titleOf } from "../src/alarms/attention";
import { whyNotFollow } from "../src/alarms/panel";
import { counted, commanded, mayAcknowledge, raised, worst, type Alarm, type Severity } from "../src/alarms/model";
import { initial, type State } from "../src/state";
import { texts } from "../src/texts";
import { update, type Message } from "../src/update";
import { frame } from "./frames";
import { live, page, settled } from "./pages";
import { status } from "./statuses";

const alarm = (id: string, severity: Severity, change: Partial<Alarm> = {}): Alarm => ({
  id, severity, cause: "vehicle-lost", text: `Vehicle ${id} lost: no telemetry for 2.0 s. Formation closes the gap.`, advice: "", vehicles: [id],
  since_unix_time_s: 100, raised_unix_time_s: 100, ended_unix_time_s: null, acknowledged_by: null, acknowledged_unix_time_s: null, command_id: null, reasons: [], action: null,
  ...change,
});
const seen = { acknowledged_by: "anna", acknowledged_unix_time_s: 120 };
const reported = (...alarms: Alarm[]): Message => ({ kind: "status", status: { ...status(), alarms } });
const tick = (now_ms: number): Message => ({ kind: "tick", now_ms });
const after = (state: State, ...messages: Message[]): State => messages.reduce(update, state);
const ids = (alarms: readonly Alarm[]): string[] => alarms.map((each) => each.id);

describe("the list of alarms", () => {
  const twelve = (["emergency", "warning", "caution", "information"] as const).flatMap((severity, i) =>
    [3, 1, 2].map((age) => alarm(`${severity} ${age}`, severity, { raised_unix_time_s: 1000 - age + i })),
  );

  it("has the most severe first and the newest first of these, in whatever order they came", () => {
    const expected = ["emergency", "warning", "caution", "information"].flatMap((severity) => [1, 2, 3].map((age) => `${severity} ${age}`));
    for (let turn = 0; turn < twelve.length; turn++) {
      const mixed = [...twelve.slice(turn), ...twelve.slice(0, turn)].sort((a, b) => (a.text.length * 7 + turn) % 5 - (b.text.length * 3 + turn) % 5);
      expect(ids(commanded(mixed))).toEqual(expected);
    }
  });

  it("has what is over behind everything that lasts", () => {
    expect(ids(commanded([alarm("over", "emergency", { ended_unix_time_s: 110 }), alarm("lasts", "information")]))).toEqual(["lasts", "over"]);
  });

  it("says how severe the whole is by what lasts, seen or not", () => {
    expect(worst([])).toBe("normal");
    expect(worst([alarm("a", "caution"), alarm("b", "warning", seen)])).toBe("warning");
    expect(worst([alarm("a", "caution"), alarm("b", "emergency", { ended_unix_time_s: 110 })])).toBe("caution");
  });

  it("counts each severity, and says nothing of what there is none of", () => {
    expect(counted([alarm("a", "caution"), alarm("b", "emergency"), alarm("c", "caution")])).toEqual([
      { severity: "emergency", count: 1 },
      { severity: "caution", count: 2 },
    ]);
  });

  it("calls new what is new, concerns one vehicle more or is more severe; not what was seen or changes its words", () => {
    const before = [alarm("a", "caution"), alarm("b", "warning")];
    expect(ids(raised(before, [...before, alarm("c", "information")]))).toEqual(["c"]);
    expect(ids(raised(before, [alarm("a", "caution", { raised_unix_time_s: 130 })]))).toEqual(["a"]);
    expect(ids(raised(before, [alarm("a", "warning")]))).toEqual(["a"]);
    expect(raised(before, [alarm("a", "caution", { text: "other", ...seen }), alarm("b", "warning", { ended_unix_time_s: 140 })])).toEqual([]);
  });
});

describe("a screen reader", () => {
  it("announces each alarm once, emergencies and warnings at once, the others when it is idle", () => {
    const first = after(initial(0), reported(alarm("d3", "warning"), alarm("d4", "caution")));
    expect(first.attention.announced.urgent).toBe("warning: Vehicle d3 lost: no telemetry for 2.0 s. Formation closes the gap.");
    expect(first.attention.announced.calm).toContain("caution: Vehicle d4");
    const again = after(first, reported(alarm("d3", "warning", seen), alarm("d4", "caution")), tick(9000));
    expect(again.attention.announced).toBe(first.attention.announced);
    const more = after(again, reported(alarm("d3", "warning"), alarm("d4", "caution"), alarm("d5", "emergency")));
    expect(more.attention.announced).toMatchObject({ number: 2, calm: "" });
    expect(more.attention.announced.urgent).not.toContain("d3");
  });

  it("announces again after another service answers with new ids", () => {
    const first = after(initial(0), reported(alarm("a-1", "warning")));
    const other: Message = { kind: "status", status: { ...status({ began_unix_time_s: 1_790_000_100 }), alarms: [alarm("a-1", "warning")] } };
    expect(after(first, other).attention.announced.number).toBe(2);
  });
});

describe("the sound", () => {
  const rings = (state: State): number => state.attention.ring.count;

  it("rings once for each batch of new alarms, as severe as the worst, and never for information", () => {
    const state = after(initial(0), reported(alarm("a", "caution"), alarm("b", "emergency"), alarm("c", "information")));
    expect(state.attention.ring).toEqual({ count: 1, severity: "emergency" });
    expect(rings(after(initial(0), reported(alarm("c", "information"))))).toBe(0);
  });

  it("goes on until an emergency or a warning is acknowledged, an emergency sooner; a caution rings once", () => {
    const emergency = after(initial(0), reported(alarm("a", "emergency")));
    expect(rings(after(emergency, tick(REPEATED_MS.emergency! - 1)))).toBe(1);
    expect(rings(after(emergency, tick(REPEATED_MS.emergency!), tick(REPEATED_MS.emergency! + 50)))).toBe(2);
    expect(rings(after(emergency, reported(alarm("a", "emergency", seen)), tick(1e6)))).toBe(1);
    const warning = after(initial(0), reported(alarm("a", "warning")));
    expect(rings(after(warning, tick(REPEATED_MS.emergency!)))).toBe(1);
    expect(rings(after(warning, tick(REPEATED_MS.warning!)))).toBe(2);
    expect(rings(after(initial(0), reported(alarm("a", "caution")), tick(1e6)))).toBe(1);
  });

  it("is silent while it is switched off, and in a replay; switched on again it sounds for unacknowledged alarms", () => {
    const off = after(initial(0), { kind: "sound", on: false }, reported(alarm("a", "emergency")), tick(60_000));
    expect(rings(off)).toBe(0);
    expect(rings(after(off, { kind: "sound", on: true }, tick(60_050)))).toBe(1);
    const replay = { file: "f", began_unix_time_s: 0, duration_s: 9, position_s: 0, speed: 1, paused: false, ended: false, skips_idle: true };
    const record: Message = { kind: "status", status: { ...status({ replay }), alarms: [alarm("a", "emergency")] } };
    expect(rings(after(initial(0), record, tick(60_000)))).toBe(0);
  });
});

describe("a connection that is lost", () => {
  const live = (airborne: number): State =>
    after(initial(0), { kind: "status", status: status({ counts: { ...status().counts, airborne } }) }, { kind: "frame", frame: frame({ vehicles: [] }, 0) });
  const rings = (state: State): number => state.attention.ring.count;

  it("sounds as an emergency while vehicles are in the air, again and again; alarms that are known are not forgotten", () => {
    const lost = after(live(3), tick(500), tick(1500), tick(1600));
    expect(lost.attention.ring).toEqual({ count: 1, severity: "emergency" });
    expect(rings(after(lost, tick(1500 + REPEATED_MS.warning!)))).toBe(2);
    expect(rings(after(lost, { kind: "frame", frame: frame({ vehicles: [] }, 1700) }, tick(1800)))).toBe(1);
  });

  it("is silent with everything on the ground", () => {
    expect(rings(after(live(0), tick(1500), tick(60_000)))).toBe(0);
  });
});

describe("title and icon", () => {
  it("say the worst, how many of it there are and what the newest is about", () => {
    const alarms = [alarm("d3", "warning"), alarm("d4", "warning", { raised_unix_time_s: 140 }), alarm("d5", "caution")];
    expect(titleOf("Station", alarms)).toBe("WARNING 2: Vehicle d4 lost · Station");
    expect(iconOf(alarms)).toBe("warning");
  });

  it("are as always where there is nothing to act on", () => {
    expect([titleOf("Station", []), iconOf([])]).toEqual(["Station", "normal"]);
    expect([titleOf("Station", [alarm("a", "information")]), iconOf([alarm("a", "information")])]).toEqual(["Station", "normal"]);
  });
});

it("no text of the page has two marks where there should be one", () => {
  const badly = /[.,;:][,;]|[,;:]\.|\s[.,;](\s|$)/;
  const all = (node: unknown): string[] => {
    if (typeof node === "string") return [node];
    if (typeof node === "function") return [...String(node).matchAll(/"([^"]*)"|`([^`]*)`/g)].map((each) => each[1] ?? each[2]!.replaceAll(/\$\{[^}]*\}/g, "3"));
    return typeof node === "object" && node !== null ? Object.values(node).flatMap(all) : [];
  };
  expect(all(texts).length).toBeGreaterThan(300);
  expect(all(texts).filter((text) => badly.test(text))).toEqual([]);
});

it("a panel that is asked for is seen: all alarms, which lie over it, are folded", () => {
  const { actions, state } = page(live({ status: { ...status(), alarms: [alarm("a", "warning")] } }), () => ({}), "refused");
  actions.openPanel("fleet");
  actions.set({ allAlarms: true });
  actions.togglePanel("fleet");
  expect([state().panels.allAlarms, state().panels.right]).toEqual([false, "fleet"]);
});

describe("the button of an alarm", () => {
  const flying = (phase: "formation" | "standby"): State =>
    live({ status: { ...status(), alarms: [] }, frame: frame({ vehicles: [{ phase }] }, 0) });
  const low = alarm("d1", "warning", { cause: "low-battery", action: "return", vehicles: ["d1"] });

  it("does what the text advises, where that is possible", () => {
    expect(whyNotFollow(flying("formation"), low)).toBe("");
    expect(whyNotFollow(flying("standby"), low)).not.toBe("");
    expect(whyNotFollow(flying("formation"), { ...low, action: null })).not.toBe("");
  });

  it("acknowledges what the service lets it: not that control has stopped, and not twice", () => {
    const all = [low, { ...low, ...seen }, alarm("x", "emergency", { cause: "control-stopped" })];
    expect(all.map(mayAcknowledge)).toEqual([true, false, false]);
  });

  it.each([
    alarm("wind", "warning", { cause: "wind", action: "stop", vehicles: ["d1"] }),
    alarm("3C6444", "emergency", { cause: "traffic-manned", action: "return", vehicles: [] }),
  ])("lets all return home where the alarm is of the show: $id", async (ofShow) => {
    const { actions, calls } = page(flying("formation"), () => ({ outcomes: {} }), "refused");
    expect(whyNotFollow(flying("formation"), ofShow)).toBe("");
    actions.follow(ofShow);
    await settled();
    expect(calls[0]).toMatchObject({ call: "POST /api/v1/show/stop" });
  });

  it("sends the command to the vehicles of the alarm", async () => {
    const { actions, calls } = page(flying("formation"), () => ({ outcomes: {} }), "refused");
    actions.follow(low);
    await settled();
    expect(calls[0]).toMatchObject({ call: "POST /api/v1/fleet/return", body: { vehicles: ["d1"] } });
  });

  it("confirms a vehicle down only when it is pressed twice", async () => {
    const { actions, calls } = page(flying("formation"), () => ({ outcomes: {} }), "refused");
    const lost = alarm("d1", "warning", { action: "confirm-down" });
    actions.follow(lost);
    await settled();
    expect(calls).toEqual([]);
    actions.follow(lost);
    await settled();
    expect(calls.map((each) => each.call)).toContain("POST /api/v1/vehicles/{vehicle_id}/confirm-down");
  });
});
