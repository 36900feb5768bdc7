import { describe, expect, it } from "vitest";

import { drawnBar } from "../src/drawn/bar";
import { colourAt, cueAt, decoded, placeAt, shown_s } from "../src/drawn/model";
import { shows } from "../src/panels/shows";
import { followed, worthSeeing } from "../src/scene/framing";
import { Poses } from "../src/scene/playback";
import type { DrawnSamples } from "../src/state";
import { texts } from "../src/texts";
import { frame } from "./frames";
import { live, page, settled } from "./pages";
import { press, textOf } from "./pressing";
import { GROUNDED, status } from "./statuses";

/** Two vehicles for 3 s, one sample a second; the law leads in the last. */
const SAMPLES: DrawnSamples = {
  show: "night", vehicles: ["a", "b"], duration_s: 3, from_s: 0, rate_hz: 1,
  positions_m: [[0, 0, 10, 4, 0, 10], [2, 0, 10, 4, 8, 12], [2, 0, 20, 4, 8, 12], []],
  colours: ["ff000000ff00", "00000000ff00", "0000ff00ff00", ""],
  cues: [{ cue: "wall", at_s: 0 }, { cue: "wave", at_s: 1.5 }],
};

const night = { name: "night", size_bytes: 900, hash: null, drawing: "night.skyc", replaced: false };
const ON_GROUND = status({ counts: GROUNDED, show: { ...status().show, phase: "idle", possible: ["start"] } });

const opening = (routes: Record<string, unknown>) =>
  page(live({ status: ON_GROUND, frame: frame({}) }), ({ call }) => routes[call], "night.skyc: show.json: not JSON");

const GOOD = {
  "POST /api/v1/shows": { show: "night", drawing: "night.skyc", vehicles: 2, duration_s: 3, claims: {}, notes: ["music"] },
  "GET /api/v1/shows": [night],
  "GET /api/v1/shows/{name}/drawing": SAMPLES,
  "POST /api/v1/shows/{name}/check": { name: "night", state: "done", reason: "", hash: null, good: false, fits_service: true, problems: [], figures: null },
};

const chosen = (name: string, size = 4) => ({ files: [{ name, size, text: async () => "" }], value: name });

describe("upload of a drawing", () => {
  it("stores it, lists it, opens its preview and has it checked", async () => {
    const { calls, actions, state } = opening(GOOD);
    const input = chosen("night.SKYC");
    press(shows(state(), actions), "show-upload", "change", input);
    expect(textOf(shows(state(), actions))).toContain(texts.shows.reading);
    await settled();
    expect(calls.map((each) => each.call)).toEqual([
      "POST /api/v1/shows", "POST /api/v1/shows/{name}/check", "GET /api/v1/shows", "GET /api/v1/shows/{name}/check", "GET /api/v1/shows/{name}/drawing",
    ]);
    expect(calls[0]).toMatchObject({ query: { name: "night", format: "skyc" }, body: input.files[0] });
    expect(state().drawn?.drawing.show).toBe("night");
    expect(state().panels.reading).toBe("");
    expect(state().toasts.map((each) => each.text)).toContain("night uploaded: 2 vehicles, 3 s; not used: music");
  });

  it("shows the service's words where it is refused", async () => {
    const { actions, state } = opening({});
    press(shows(state(), actions), "show-upload", "change", chosen("night.skyc"));
    await settled();
    expect(state().toasts.at(-1)?.text).toContain("night.skyc: show.json: not JSON");
    expect([state().drawn, state().panels.reading]).toEqual([null, ""]);
  });

  it("is not sent when it is too large, or has a name that no show has", async () => {
    const { calls, actions, state } = opening(GOOD);
    press(shows(state(), actions), "show-upload", "change", chosen("night.skyc", 33 * 1024 * 1024));
    press(shows(state(), actions), "show-upload", "change", chosen("a night.skyc"));
    await settled();
    expect(calls).toEqual([]);
    expect(state().toasts.map((each) => each.text).join()).toContain("32 MiB");
  });
});

describe("the preview of a drawn show", () => {
  async function opened() {
    const all = opening(GOOD);
    all.dispatch({ kind: "shows", shows: [night, { ...night, name: "plain", drawing: null }] });
    press(shows(all.state(), all.actions), "show-preview-night");
    await settled();
    const bar = () => drawnBar(all.state(), all.actions);
    return { ...all, bar, now_s: () => shown_s(all.state().drawn!, all.state().page_ms) };
  }

  it("is offered for shows with a drawing, and brings it into the picture", async () => {
    const { state, actions } = await opened();
    expect(() => press(shows(state(), actions), "show-preview-plain")).toThrow("nothing to press");
    expect(state().view.fits).toBe(1);
    expect([...worthSeeing(state(), new Poses(), [])]).toContainEqual([8, 12, -4]);
  });

  it("plays, pauses, stops at the end and begins again", async () => {
    const { state, bar, dispatch, now_s } = await opened();
    expect(now_s()).toBe(0);
    press(bar(), "drawn-play");
    dispatch({ kind: "tick", now_ms: state().page_ms + 1250 });
    expect(now_s()).toBeCloseTo(1.25);
    press(bar(), "drawn-play");
    dispatch({ kind: "tick", now_ms: state().page_ms + 5000 });
    expect(now_s()).toBeCloseTo(1.25);
    press(bar(), "drawn-play");
    dispatch({ kind: "tick", now_ms: state().page_ms + 5000 });
    expect([now_s(), state().drawn!.since_ms]).toEqual([3, null]);
    press(bar(), "drawn-play");
    expect([now_s(), state().drawn!.since_ms]).toEqual([0, state().page_ms]);
  });

  it("is scrubbed, also while it plays", async () => {
    const { state, bar, dispatch, now_s } = await opened();
    press(bar(), "drawn-scrubber", "input", { value: "2" });
    expect(now_s()).toBe(2);
    expect(textOf(bar())).toContain("wave");
    press(bar(), "drawn-play");
    dispatch({ kind: "tick", now_ms: state().page_ms + 500 });
    press(bar(), "drawn-scrubber", "input", { value: "0.5" });
    dispatch({ kind: "tick", now_ms: state().page_ms + 250 });
    expect(now_s()).toBeCloseTo(0.75);
    press(bar(), "drawn-scrubber", "input", { value: "99" });
    expect(now_s()).toBe(3);
  });

  it("is closed by a press, and when the fleet starts", async () => {
    const { state, bar, dispatch } = await opened();
    const open = state().drawn!.drawing;
    press(bar(), "drawn-close");
    expect(state().drawn).toBeNull();
    dispatch({ kind: "drawn", drawing: open });
    dispatch({ kind: "status", status: ON_GROUND });
    expect(state().drawn).not.toBeNull();
    dispatch({ kind: "status", status: status() });
    expect(state().drawn).toBeNull();
  });

  it("is refused while vehicles fly", async () => {
    const { calls, actions, dispatch, state } = opening(GOOD);
    dispatch({ kind: "status", status: status() });
    actions.previewShow("night");
    await settled();
    expect(calls).toEqual([]);
    expect(state().toasts.at(-1)?.kind).toBe("refused");
  });
});

describe("samples of a drawing", () => {
  const drawing = decoded(SAMPLES);

  it("are joined by straight lines, in place and colour", () => {
    expect(placeAt(drawing, 0, 0.5)).toEqual([1, 0, 10]);
    expect(placeAt(drawing, 1, 1)).toEqual([4, 8, 12]);
    expect(colourAt(drawing, 0, 0.5)).toEqual([0.5, 0, 0]);
    expect(colourAt(drawing, 1, 2)).toEqual([0, 1, 0]);
    expect(cueAt(drawing, 1)).toBe("wall");
  });

  it("are unknown where the law leads", () => {
    expect(placeAt(drawing, 0, 2.5)[0]).toBeNaN();
  });

  it("have an outline for the camera, which parked vehicles do not widen", () => {
    expect(drawing.outline).toContainEqual([2, 0, 20]);
    expect(drawing.outline.every((place) => place.every(Number.isFinite))).toBe(true);
    const parked = new Poses();
    const far = frame({ vehicles: [{ x_m: 900, y_m: 0, height_m: 0 }] });
    parked.set({ from: far, to: far, share: 1, beyond_s: 0, still: true, run: 0 }, 0);
    const state = live({ status: ON_GROUND, frame: frame({}), drawn: { drawing, at_s: 0, since_ms: null } });
    expect(followed(state, parked)).toEqual([]);
    expect(Math.max(...[...worthSeeing(state, parked, [0])].map((place) => Math.abs(place[2])))).toBe(4);
  });
});
