// Targets that the formation can follow: their panel, and their marks in the scene.

import { Group, Mesh } from "three";
import { describe, expect, it } from "vitest";

import { panelsOf } from "../src/features";
import { away_m, fixesAt, offs, t, targets, Track } from "../src/features/targets";
import { toScene } from "../src/scene/axes";
import { Eye } from "../src/scene/camera";
import type { Overlay } from "../src/scene/overlay";
import { NIGHT } from "../src/scene/palette";
import { project, type Screen } from "../src/scene/picking";
import { START } from "../src/scene/rig";
import type { Features, Right, State, Status } from "../src/state";
import { update } from "../src/update";
import { frame } from "./frames";
import { access, live, page, settled } from "./pages";
import { press, textOf } from "./pressing";
import { status } from "./statuses";

type Reported = NonNullable<Features["targets"]>["targets"][number];
const BOAT: Reported = {
  name: "boat", source: "rest", state: "tracked", why: "", age_s: 0.2, rate_hz: 5, x_m: 30, y_m: 40, velocity_x_m_s: 3, velocity_y_m_s: -4,
  deviation_m: 0.75, height_m: null, clearance_m: 0, reports: 100, refused: 0,
};
const SHOW: NonNullable<Status["show"]["selected"]> = {
  name: "circle", hash: "ab", cue: "stand", cues: ["stand"], clock_s: 0, duration_s: 60, runs: false, target_is_live: false,
  track_rms_m: null, track_max_m: null, spares: [], begin: null, begun: false,
};
const OWN: Status["stations"][number] = {
  name: "north", own: true, leads: false, received: true, silent_s: 0, show: "running", vehicles: 1, delay_s: 0, term: 1, offers: [],
};

interface Given {
  boat?: Partial<Reported>;
  selected?: string;
  now_s?: number;
  rights?: Right[];
  change?: Partial<Status>;
}

/** Read at 10 s of the service's clock, shown at `now_s`. */
function state({ boat = {}, selected = "", now_s = 10, rights, change = {} }: Given = {}): State {
  const all: Reported[] = [{ ...BOAT, ...boat }, { ...BOAT, name: "walker", source: "cot", state: "none", why: "nothing was received yet", age_s: null, x_m: null, y_m: null }];
  const features: Features = { ...status().features, targets: { selected: "", follows_m_s: 9.6, reach_m: 280, off_m: null, targets: all } };
  const read = update(
    live({ access: access(rights), frame: frame({ center_m: [0, 0, 20], vehicles: [{}] }), status: status({ ...change, features: { ...features, targets: { selected, follows_m_s: 9.6, reach_m: 280, off_m: null, targets: [] } } }) }),
    { kind: "features", features },
  );
  return { ...read, frame: frame({ time_s: now_s, center_m: [0, 0, 20], vehicles: [{}] }) };
}

const boatAt = (given: Given, now_s = 10) => fixesAt(state(given), now_s)[0]!;

/** One reading a second, of these distances. */
function read(offs_m: (number | null)[]): State {
  return offs_m.reduce((before: State, off_m, at) => {
    const features = { ...before.features!, targets: { ...before.features!.targets!, selected: "boat", off_m } };
    return update({ ...before, frame: frame({ time_s: 11 + at, center_m: [0, 0, 20], vehicles: [{}] }) }, { kind: "features", features });
  }, state({ selected: "boat" }));
}

const over = (first: State) => page(first, () => ({}), "refused");
const view = (state: State, why = "") => targets.panel!.view(state, over(state).actions, why);

describe("the tracking error", () => {
  it("is what was read in the last minute, with a gap where it was not known", () => {
    expect(offs(read([1, 2, null, null, 4]), "boat", 15)).toEqual([[[-4, 1], [-3, 2]], [[0, 4]]]);
    expect(offs(read([1, 2]), "walker", 12)).toEqual([]);
    const long = read(Array.from({ length: 100 }, () => 1));
    expect(long.featuresPast).toHaveLength(61);
    expect(offs(long, "boat", 110)[0]).toHaveLength(61);
  });

  it("has no reading that is later than now, once a clock goes back", () => {
    const late = read([1, 2, 3, 4]);
    const back = update({ ...late, frame: frame({ time_s: 12, vehicles: [{}] }) }, { kind: "features", features: late.features! });
    expect(Math.max(...back.featuresPast.map((each) => each.read_s))).toBe(12);
  });
});

describe("what is known of a target", () => {
  it("moves on from its reading with its velocity, and is not known once that is old", () => {
    expect(boatAt({}, 12)).toMatchObject({ x_m: 36, y_m: 32, age_s: 0.2, radius_m: 1.5, state: "tracked", why: "" });
    expect(boatAt({}, 14)).toMatchObject({ state: "unread", age_s: 4.2, why: t.unread("4.0 s"), x_m: NaN, radius_m: NaN });
    expect(away_m(state(), boatAt({}))).toBe(50);
  });

  it("is no place once it is lost, however the service moves its estimate on", () => {
    const lost = boatAt({ boat: { state: "lost", why: "nothing for 9.0 s" } });
    expect(lost).toMatchObject({ x_m: NaN, velocity_x_m_s: NaN, radius_m: NaN, rate_hz: NaN, why: "nothing for 9.0 s" });
    expect(away_m(state(), lost)).toBeNaN();
  });
});

describe("the panel of targets", () => {
  it("is there where targets are configured only", () => {
    expect(panelsOf(null)).toEqual([]);
    expect(panelsOf(status())).toEqual([]);
    expect(panelsOf(state().status).map((each) => each.title)).toEqual([t.title]);
    const open = update(state(), { kind: "panels", change: { right: targets.panel!.name } });
    expect(update(open, { kind: "status", status: state().status! }).panels.right).toBe(targets.panel!.name);
    expect(update(open, { kind: "status", status: status() }).panels.right).toBe("fleet");
  });

  it("shows each with its source, state and numbers, and marks the selected one", () => {
    const text = textOf(view(state({ selected: "boat" })));
    expect(textOf(view(state({ selected: "boat", boat: { state: "lost" } })))).toContain(`${t.selected}</span>`); // it holds
    for (const part of [">rest<", "tracked", "0.2 s", "5.0 Hz", "5.0 m/s", "1.5 m", "50.0 m", t.followed, t.states.none, "nothing was received yet"]) expect(text).toContain(part);
    expect(textOf(view(state()))).not.toContain(t.followed);
    expect(textOf(view(state({ boat: { state: "coasting", why: "nothing for 1.0 s" } })))).toContain("coasting");
  });

  it("says where the selected one is not followed", () => {
    for (const [change, why] of [[{ show: { ...status().show, selected: SHOW } }, t.byShow("circle")], [{ stations: [OWN] }, t.byLead]] as const) {
      const text = textOf(view(state({ selected: "boat", change: change as Partial<Status> })));
      expect(text).toContain(why);
      expect(text).not.toContain(`${t.followed}</span>`);
    }
  });

  it("has one followed with the second press, which names how far the formation flies", async () => {
    const ui = over(state());
    const click = (name: string): void => press(targets.panel!.view(ui.state(), ui.actions, ""), name);
    click("target-follow-boat");
    expect(ui.calls).toEqual([]);
    expect(textOf(targets.panel!.view(ui.state(), ui.actions, ""))).toContain(t.sure("boat", "50.0 m"));
    click("target-follow-boat");
    click("target-hold");
    await settled();
    expect(ui.calls.map(({ call, body }) => [call, body])).toEqual([["POST /api/v1/targets/select", { name: "boat" }], ["POST /api/v1/targets/hold", undefined]]);
    expect(ui.state().toasts.map((each) => each.text)).toEqual([t.follows("boat"), t.holds]);
  });

  it("says why one cannot be followed: no right, or it is already; a lost one can be followed again", () => {
    const refused = (now: State, why = ""): string | undefined => {
      const ui = over(now);
      press(targets.panel!.view(now, ui.actions, why), "target-follow-boat");
      return ui.state().toasts[0]?.text;
    };
    expect(refused(state(), "no right")).toContain("no right");
    expect(refused(state({ selected: "boat" }))).toContain(t.isFollowed("boat"));
    expect(refused(state({ selected: "boat", boat: { state: "lost" } }))).toBeUndefined();
  });
});

describe("targets in the scene", () => {
  const SCREEN: Screen = { width: 1200, height: 800, free: { left: 0, top: 0, width: 1200, height: 800 } };
  const eye = new Eye(START, SCREEN);
  const at = (x_m: number, y_m: number) => project(eye.basis, eye.pose, SCREEN, toScene(x_m, y_m, 0))!;

  function scene() {
    const group = new Group();
    const layer = targets.layer!(eye.shared, group);
    const words: string[] = [];
    const overlay = { put: (_eye: Eye, _at: unknown, text: string) => words.push(text) } as unknown as Overlay;
    const draw = (given: Given, time_s = 10): { words: string[]; lines: number } => {
      words.length = 0;
      layer.draw(state(given), time_s, NIGHT, eye, overlay);
      return { words: [...words], lines: group.children.reduce((sum, each) => sum + (each as Mesh).geometry.drawRange.count / 6, 0) };
    };
    return { layer, draw };
  }

  it("draws a diamond, a circle and its way of the next seconds, then the track; a lost one is a cross where it was", () => {
    const { draw } = scene();
    const mark = 4 + 32 + 1 + 1; // and from where it was read last to where it is
    expect(draw({})).toEqual({ words: ["boat"], lines: mark }); // of the walker nothing is known
    expect(draw({ selected: "boat" }, 11)).toEqual({ words: ["boat · followed"], lines: mark + 1 });
    expect(draw({ boat: { state: "coasting" } }, 12)).toEqual({ words: ["boat · coasting"], lines: mark + 2 });
    expect(draw({ boat: { state: "lost" } }, 12.5)).toEqual({ words: ["boat · LOST"], lines: 2 + 2 });
    expect(draw({ boat: { state: "lost" } }, 100).lines).toBe(2); // its track is older than a minute
  });

  it("asks in the panel whether the one that is clicked on is to be followed", () => {
    const { draw, layer } = scene();
    draw({});
    const { px, py } = at(30, 40);
    expect(layer.questionAt(px + 5, py, eye)).toEqual({ panel: targets.panel!.name, sure: "target:boat" });
    expect(layer.questionAt(px + 60, py, eye)).toBeNull();
    draw({ rights: ["watch"] });
    expect(layer.questionAt(px, py, eye)?.sure).toBe("");
    draw({ selected: "boat" });
    expect(layer.questionAt(px, py, eye)?.sure).toBe("");
  });

  it("joins no places across a gap or a jump", () => {
    const track = new Track();
    for (const [time_s, x_m] of [[0, 0], [1, 3], [9, 20], [10, 500]] as const) track.add(time_s, { ...boatAt({}), x_m });
    expect(track.lines()).toEqual([[[0, 0, 40], [1, 3, 40]]]);
    track.add(65, { ...boatAt({}), x_m: NaN });
    expect(track.places.map(([time_s]) => time_s)).toEqual([9, 10]);
  });
});
