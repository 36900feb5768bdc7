import { describe, expect, it } from "vitest";

import { corrections as feature, t } from "../src/features/corrections";
import { t as lightTexts } from "../src/features/lights";
import { createReader } from "../src/panels/reading";
import { whyNotVehicle } from "../src/panels/rights";
import type { Features, State } from "../src/state";
import { texts } from "../src/texts";
import { update } from "../src/update";
import { frame } from "./frames";
import { access, live } from "./pages";
import { textOf } from "./pressing";
import { GROUNDED, status } from "./statuses";

const FOUND: NonNullable<Features["corrections"]> = {
  source: "ntrip://192.0.2.7:2101/BASE", age_s: 0.84, problem: "", base_latitude_deg: 47.4, base_longitude_deg: 8.5, base_height_m: 510.2,
  messages: 1200, received_bytes: 90_000, sent: 2400, dropped: 3,
};
const vehicle = status().vehicles[0]!;

const corrections = (state: State) => feature.glance!(state);

/** With these corrections; null: none are configured. */
const of = (found: typeof FOUND | null): Features => ({ corrections: found, timecode: null, targets: null, traffic: null, tak: null, fences: null, remote_id: null, wind: null, go: null, site: null, lights: { driver: "led-control", sent: 0, dropped: 0 } });

function state(change: Partial<State> = {}): State {
  const vehicles = [{ ...vehicle, fix_type: 6 }, { ...vehicle, id: "d2", fix_type: 5 }];
  return live({ frame: frame({ vehicles: [{ phase: "standby" }] }), status: status({ counts: GROUNDED, features: of(FOUND), vehicles }), ...change });
}

describe("corrections for RTK", () => {
  it("show age, fixes, base and messages", () => {
    const text = textOf(corrections(state({ features: of(FOUND) })));
    for (const part of ["0.8 s", "1 fixed, 1 float of 2", "47.400000, 8.500000, 510.2 m", "1200, 3 dropped", "2400 sent"]) expect(text).toContain(part);
  });

  it("say that they stopped, and why", () => {
    const text = textOf(corrections(state({ features: of({ ...FOUND, problem: "none for 12 s", age_s: 12 }) })));
    expect(text).toContain(t.stopped);
    expect(text).toContain("none for 12 s");
  });

  it("are silent where none are configured, and show what is not known yet", () => {
    expect(textOf(corrections(state({ features: of(null) })))).not.toContain("corrections-age");
    const text = textOf(corrections(state({ features: of({ ...FOUND, age_s: null, base_latitude_deg: null }) })));
    expect(text).toContain(t.none);
    expect(text).not.toContain("corrections-base");
  });

  it("are read once a second, where they are configured", () => {
    let reads = 0;
    const nothing = async (): Promise<boolean> => true;
    const read = createReader({
      loadPreflight: nothing, loadOrders: nothing, loadStations: nothing, loadPlacement: nothing, loadShows: nothing, loadMarks: nothing, loadSite: nothing,
      loadFeatures: () => ((reads += 1), Promise.resolve(true)),
    });
    const at = (now_ms: number, change: Partial<State> = {}): State => ({ ...state(change), page_ms: now_ms, frame: { ...state().frame!, received_ms: now_ms } });
    read(at(0));
    read(at(500));
    expect(reads).toBe(1);
    read(at(1500, { status: status({ features: of(null) }) }));
    expect(reads).toBe(1);
    const kept = update(state(), { kind: "features", features: of(FOUND) });
    expect(kept.features?.corrections).toBe(FOUND);
  });
});

describe("find", () => {
  it("is for vehicles on the ground, where lights are sent", () => {
    expect(whyNotVehicle(state(), "find", "standby")).toBe("");
    expect(whyNotVehicle(state(), "find", "formation")).toContain(texts.fleet.phases.formation);
    expect(whyNotVehicle(state({ status: status({ features: { ...of(null), lights: { driver: "none", sent: 0, dropped: 0 } } }) }), "find", "standby")).toBe(lightTexts.noLights);
    expect(whyNotVehicle(state({ access: access(["watch"]) }), "find", "standby")).not.toBe("");
  });
});
