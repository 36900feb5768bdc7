import { expect, it } from "vitest";

import type { PanelActions } from "../src/panels/actions";
import { vehicle } from "../src/panels/vehicle";
import { initial, type Frame, type FrameColumn, type State } from "../src/state";
import { frame } from "./frames";
import { textOf } from "./pressing";
import { COLUMNS, status } from "./statuses";

/** A column that the page does not know. */
const WIND = { name: "wind_m_s", unit: "m/s", label: "Wind" } as unknown as FrameColumn;

it("the page of a vehicle shows a number that only the status names", () => {
  const start = initial(0);
  const known = frame({ vehicles: [{ battery: 0.5, uncertainty_m: 0.2 }] });
  const state: State = {
    ...start, status: status({ columns: [...COLUMNS, WIND] }), frame: { ...known, wind_m_s: Float32Array.of(4.5) } as Frame,
    view: { ...start.view, selected: "d1", selection: ["d1"] },
  };
  const text = textOf(vehicle(state, {} as PanelActions));
  for (const part of ["Wind", "4.5 m/s", "Heartbeat age", "Link quality", "50 %"]) expect(text).toContain(part);
});
