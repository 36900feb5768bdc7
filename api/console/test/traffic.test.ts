// Other traffic: what the panel says of it, and where it is in the scene.

import { Group, Mesh } from "three";
import { describe, expect, it } from "vitest";

import { panelsOf } from "../src/features";
import { t, traffic, trafficAt } from "../src/features/traffic";
import { Eye } from "../src/scene/camera";
import type { Overlay } from "../src/scene/overlay";
import { NIGHT } from "../src/scene/palette";
import { START } from "../src/scene/rig";
import type { Features, State } from "../src/state";
import { update } from "../src/update";
import { frame } from "./frames";
import { live, page } from "./pages";
import { textOf } from "./pressing";
import { status } from "./statuses";

type Traffic = NonNullable<Features["traffic"]>;
const PLANE: Traffic["nearest"][number] = {
  id: "3C6444", kind: "manned", x_m: 300, y_m: 40, height_m: 90, velocity_x_m_s: -30, velocity_y_m_s: 0, climb_m_s: 0, deviation_m: 3, age_s: 0.5,
  away_m: 290, nearest_m: 30, nearest_s: 9, evaded: true, near: true,
};
const TRAFFIC: Traffic = { known: 1, near: 1, manned: 1, problem: "", reports: 10, refused: 0, radius_m: 30, half_height_m: 15, nearest: [PLANE] };

/** Read at 10 s of the service's clock, shown at `now_s`. */
function state(change: Partial<Traffic> = {}, now_s = 10): State {
  const features: Features = { ...status().features, traffic: { ...TRAFFIC, ...change } };
  const read = update(live({ frame: frame({ vehicles: [{}] }), status: status({ features }) }), { kind: "features", features });
  return { ...read, frame: frame({ time_s: now_s, vehicles: [{}] }) };
}

const view = (shown: State): string => textOf(traffic.panel!.view(shown, page(shown, () => ({}), "refused").actions, ""));

describe("other traffic", () => {
  it("moves on from its reading, and is not known once that is old", () => {
    expect(trafficAt(state(), 12)!.nearest[0]).toMatchObject({ x_m: 240, y_m: 40, age_s: 2.5, speed_m_s: 30 });
    expect(trafficAt(state(), 14)).toMatchObject({ problem: t.unread("4.0 s"), nearest: [] });
    expect(trafficAt(live({ status: status() }), 10)).toBeNull();
  });

  it("has a panel where it is configured only", () => {
    expect(panelsOf(status())).toEqual([]);
    expect(panelsOf(state().status).map((each) => each.title)).toEqual([t.title]);
  });

  it("says of each track what it is, how near it comes, and when", () => {
    const text = view(state());
    for (const part of ["3C6444", t.kinds.manned, t.near, t.evaded, "290", "30.0 m", "9.0 s", "90.0 m", "30.0 m/s"]) expect(text).toContain(part);
    expect(view(state({ nearest: [] }))).toContain(t.none);
    const unknown = view(state({ nearest: [], problem: "nothing arrives" }));
    expect(unknown).toContain("nothing arrives");
    expect(unknown).not.toContain(t.none);
  });

  it("is drawn with its name", () => {
    const eye = new Eye(START, { width: 1200, height: 800, free: { left: 0, top: 0, width: 1200, height: 800 } });
    const into = new Group();
    const layer = traffic.layer!(eye.shared, into);
    const names: string[] = [];
    const overlay = { put: (_eye: Eye, _at: unknown, text: string) => void names.push(text) } as unknown as Overlay;
    layer.draw(state(), 10, NIGHT, eye, overlay);
    expect(names).toEqual(["3C6444 · manned"]);
    expect(into.children[0]).toBeInstanceOf(Mesh);
    layer.dispose();
  });
});
