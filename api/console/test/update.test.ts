import { describe, expect, test } from "vitest";

import { fresh, HISTORY_ROWS, initial, STALE_MS, TOAST_MS, type State } from "../src/state";
import { update, type Message } from "../src/update";
import { read } from "../src/connection/stream";
import { frame } from "./frames";
import { COLUMNS, command, status } from "./statuses";

const after = (...messages: Message[]): State => messages.reduce(update, initial(0));
const framed = (time_s: number, received_ms: number, alive = true): Message => ({
  kind: "frame",
  frame: frame({ time_s, controlAlive: alive, vehicles: [{}] }, received_ms),
});

describe("what is shown is fresh", () => {
  test("only while frames come", () => {
    const state = after(framed(1, 100), { kind: "tick", now_ms: 100 + STALE_MS - 1 });
    expect(fresh(state)).toBe(true);
    expect(fresh(update(state, { kind: "tick", now_ms: 100 + STALE_MS }))).toBe(false);
  });

  test("not before the first frame, nor when control does not live, nor when the connection is lost", () => {
    expect(fresh(initial(0))).toBe(false);
    expect(fresh(after(framed(1, 100, false)))).toBe(false);
    const lost: Message = { kind: "connection", connection: { kind: "lost", since_ms: 200, reason: "cut" } };
    expect(fresh(after(framed(1, 100), lost))).toBe(false);
    expect(fresh(after(framed(1, 100), lost, framed(2, 300)))).toBe(true);
  });
});

test("a connection that is lost and not found again is lost since the first time", () => {
  const lost = (since_ms: number, reason: string): Message => ({ kind: "connection", connection: { kind: "lost", since_ms, reason } });
  const state = after(framed(1, 100), lost(200, "cut"), lost(700, "no answer"));
  expect(state.connection).toEqual({ kind: "lost", since_ms: 200, reason: "no answer" });
  expect(after(framed(1, 100), lost(200, "cut"), framed(2, 300), lost(900, "cut")).connection.since_ms).toBe(900);
});

test("two frames are kept, to draw between them; of another number of vehicles there is no between", () => {
  const state = after(framed(1, 100), framed(1.1, 200));
  expect([state.previous?.time_s, state.frame?.time_s]).toEqual([1, 1.1]);
  const more: Message = { kind: "frame", frame: frame({ time_s: 2, vehicles: [{}, {}] }, 300) };
  expect(update(state, more).previous).toBeNull();
});

describe("the plots' history", () => {
  const times = (state: State): number[] => [...state.history.time_s];

  test("has a row for each half second, not for each frame", () => {
    expect(times(after(...[1, 1.1, 1.4, 1.5, 1.9, 2.25].map((s) => framed(s, 0))))).toEqual([1, 1.5, 2.25]);
  });

  test("keeps the last minutes only", () => {
    const state = after(...Array.from({ length: HISTORY_ROWS + 10 }, (_, k) => framed(k, 0)));
    expect(state.history.time_s.length).toBe(HISTORY_ROWS);
    expect(state.history.energy.length).toBe(HISTORY_ROWS);
    expect(times(state)[0]).toBe(10);
  });

  test("goes back with a replay", () => {
    expect(times(after(framed(1, 0), framed(2, 0), framed(3, 0), framed(1.5, 0)))).toEqual([1, 1.5]);
  });
});

test("no state is ever changed in place", () => {
  const before = initial(0);
  const kept = structuredClone(before);
  [framed(1, 1), framed(2, 2), { kind: "done", text: "x" } as const, { kind: "status", status: status() } as const].reduce(update, before);
  expect(before).toEqual(kept);
});

test("a service that was started again is another one: nothing of the last one is shown as its", () => {
  const report = { passes: true } as never;
  const check = { name: "parade", state: "done", reason: "", hash: "ab", good: true, fits_service: true, figures: null } as const;
  const known = after(
    { kind: "status", status: status({ time_s: 500 }) }, framed(500, 0), { kind: "preflight", report },
    { kind: "command", command: command("o1") }, { kind: "check", check: { ...check, problems: [] } },
  );
  const same = update(known, { kind: "status", status: status({ time_s: 510, revision: 2 }) });
  expect([same.frame?.time_s, same.commands.length, Object.keys(same.panels.checks)]).toEqual([500, 1, ["parade"]]);
  const began_unix_time_s = status().began_unix_time_s + 511; // its clock is the machine's, and goes on
  const state = update(known, { kind: "status", status: status({ time_s: 511, began_unix_time_s }) });
  expect(state).toMatchObject({ frame: null, previous: null, preflight: null, commands: [] });
  expect(state.history.time_s.length).toBe(0);
  expect(state.panels).toMatchObject({ checks: {}, shows: null });
});

test("a vehicle that is gone is no longer selected; one that is there stays so", () => {
  const select: Message = { kind: "select", choice: { how: "only", ids: ["d1"] } };
  const state = after({ kind: "status", status: status() }, select, { kind: "status", status: status() });
  expect(state.view.selected).toBe("d1");
  expect(update(state, { kind: "status", status: status({ vehicles: [] }) }).view.selected).toBeNull();
});

test("what was refused is told, with its reason, for a while", () => {
  const state = after({ kind: "tick", now_ms: 10 }, { kind: "refused", text: "not now" });
  expect(state.toasts).toMatchObject([{ kind: "refused", text: "not now" }]);
  expect(update(state, { kind: "tick", now_ms: 9 + TOAST_MS }).toasts).toHaveLength(1);
  expect(update(state, { kind: "tick", now_ms: 10 + TOAST_MS }).toasts).toHaveLength(0);
  expect(update(state, { kind: "toast-gone", id: state.toasts[0]!.id }).toasts).toHaveLength(0);
});

test("an armed kill is forgotten when its code is none any more, or was used", () => {
  const armed = { code: "a1b2c3", vehicles: ["d1"], valid_s: 20 };
  const state = after({ kind: "tick", now_ms: 1000 }, { kind: "kill-armed", armed });
  expect(update(state, { kind: "tick", now_ms: 20_999 }).kill?.armed.code).toBe("a1b2c3");
  expect(update(state, { kind: "tick", now_ms: 21_000 }).kill).toBeNull();
  expect(update(state, { kind: "kill-over" }).kill).toBeNull();
});

test("an order's outcome takes its own place, a new order the first", () => {
  const state = after(
    { kind: "command", command: command("o1") }, { kind: "command", command: command("o2") },
    { kind: "command", command: command("o1", "done") },
  );
  expect(state.commands.map((each) => [each.id, each.outcome])).toEqual([["o2", "pending"], ["o1", "done"]]);
});

test("what cannot be read is an error, and the state is as it was", () => {
  expect(() => read("{", COLUMNS)).toThrowError(SyntaxError);
  expect(() => read(new ArrayBuffer(3), COLUMNS)).toThrowError("a frame of 3 bytes");
});
