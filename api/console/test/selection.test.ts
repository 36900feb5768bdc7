import { describe, expect, it } from "vitest";

import { choiceOf, choose, NOTHING_SELECTED, remaining, type Choice, type Selection } from "../src/selection";

const ROWS = ["d4", "d1", "d3", "d2", "d5"]; // as a table has them in order

const after = (...choices: Choice[]): Selection => choices.reduce(choose, NOTHING_SELECTED);
const press = (id: string, keys: { shift?: boolean; ctrl?: boolean } = {}): Choice =>
  choiceOf(id, { shift: keys.shift ?? false, ctrl: keys.ctrl ?? false }, ROWS);

describe("the selection", () => {
  it("is the vehicle that was pressed, and no other", () => {
    expect(after(press("d1"), press("d3"))).toEqual({ selected: "d3", selection: ["d3"] });
  });

  it("takes a vehicle in and out with Ctrl", () => {
    expect(after(press("d1"), press("d3", { ctrl: true })).selection).toEqual(["d1", "d3"]);
    expect(after(press("d1"), press("d3", { ctrl: true }), press("d1", { ctrl: true }))).toEqual({ selected: "d3", selection: ["d3"] });
    expect(after(press("d1"), press("d1", { ctrl: true }))).toEqual(NOTHING_SELECTED);
  });

  it("reaches with Shift from the vehicle chosen last to the one pressed, by the rows on the screen, both ways", () => {
    const down = after(press("d1"), press("d2", { shift: true }));
    expect([new Set(down.selection), down.selected]).toEqual([new Set(["d1", "d3", "d2"]), "d2"]);
    const up = after(press("d5"), press("d3", { shift: true }));
    expect([new Set(up.selection), up.selected]).toEqual([new Set(["d5", "d2", "d3"]), "d3"]);
  });

  it("is one vehicle more with Shift where the last one is not in the table", () => {
    expect(after({ how: "only", ids: ["d9"] }, press("d1", { shift: true })).selection).toEqual(["d9", "d1"]);
    expect(after(press("d1", { shift: true })).selection).toEqual(["d1"]);
  });

  it("names no vehicle twice", () => {
    expect(after({ how: "only", ids: ["d1", "d2"] }, { how: "add", ids: ["d2", "d3", "d1"] }).selection).toEqual(["d2", "d3", "d1"]);
  });

  it("is empty once nothing is chosen", () => {
    expect(after(press("d1"), { how: "only", ids: [] })).toEqual(NOTHING_SELECTED);
  });

  it("loses the vehicles that the fleet no longer has, and is the same object otherwise", () => {
    const both = after({ how: "only", ids: ["d1", "d2"] });
    expect(remaining(both, (id) => id === "d1")).toEqual({ selected: "d1", selection: ["d1"] });
    expect(remaining(both, () => true)).toBe(both);
  });
});
