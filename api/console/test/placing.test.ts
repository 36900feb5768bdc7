import { describe, expect, it } from "vitest";

import { createReader } from "../src/panels/reading";
import { shows } from "../src/panels/shows";
import { beside } from "../src/placing/beside";
import { carried, isChanged, middleOf, padsOf, residual, turnedTo, type Placing } from "../src/placing/model";
import { placingBar } from "../src/placing/panel";
import { toScene } from "../src/scene/axes";
import { worthSeeing } from "../src/scene/framing";
import { padGripAt, padsMoved, turnHandle } from "../src/scene/padsLayer";
import { project, rayThrough, type Screen } from "../src/scene/picking";
import { Poses } from "../src/scene/playback";
import { basisOf, START } from "../src/scene/rig";
import { type PlacedShow, type Placement, type ShowCheck, type State } from "../src/state";
import { texts } from "../src/texts";
import { frame } from "./frames";
import { access, live, page, settled } from "./pages";
import { press, textOf } from "./pressing";
import { GROUNDED, status } from "./statuses";

const AT: Placement = { x_m: 10, y_m: 0, turn_deg: 0 };
/** Two pads 4 m apart along y; d1 stands on the second, d2 1.5 m ahead of the first. */
const PLACED: PlacedShow = {
  show: "night", ...AT, heading_deg: 0, stored: AT, written: AT, origin_changes: false, fence_distance_m: 42, assigned: "nearest",
  pads_m: [[10, -2], [10, 2]], rms_m: 1.06, max_m: 1.5,
  vehicles: [
    { id: "d1", x_m: 10, y_m: 2, pad: 1, off_m: 0 }, { id: "d2", x_m: 11.5, y_m: -2, pad: 0, off_m: 1.5 },
    { id: "d3", x_m: null, y_m: null, pad: null, off_m: null },
  ],
};
const BEST: PlacedShow = { ...PLACED, x_m: 10.75, turn_deg: 20.5, pads_m: [[10.7, -2], [10.8, 2]], max_m: 0.7 };
const ON_GROUND = status({
  counts: GROUNDED, show: { ...status().show, phase: "idle", possible: ["start"] }, vehicles: ["d1", "d2", "d3"].map((id) => ({ ...status().vehicles[0]!, id })),
});
const NIGHT = { name: "night", size_bytes: 900, hash: null, drawing: "night.skyc", replaced: false };
const CHECK: ShowCheck = { name: "night", state: "done", reason: "", hash: null, good: false, fits_service: true, problems: [], figures: null };
const STANDING = frame({ vehicles: [{ x_m: 10, y_m: 2, height_m: 0, phase: "standby" }, { x_m: 11.5, y_m: -2, height_m: 0, phase: "standby" }, { phase: "offline" }] });

/** Without `put` no placement is stored. */
function opening({ put }: { put?: PlacedShow }) {
  const all = page(live({ status: ON_GROUND, frame: STANDING }), ({ call, query }) => {
    if (call.startsWith("PUT")) return put;
    if (call.endsWith("/placement")) return query["fit"] === true ? BEST : { ...PLACED, ...query };
    return call.endsWith("/check") ? CHECK : [NIGHT];
  }, "no show 'night'");
  all.dispatch({ kind: "shows", shows: [NIGHT, { ...NIGHT, name: "plain", drawing: null }] });
  return all;
}

async function opened(answers: { put?: PlacedShow } = {}) {
  const all = opening(answers);
  press(shows(all.state(), all.actions), "show-place-night");
  await settled();
  all.calls.length = 0;
  return all;
}

describe("the placement of a drawn show", () => {
  it("is offered for shows with a drawing, and brings pads into the picture", async () => {
    const { state, actions } = await opened();
    expect(() => press(shows(state(), actions), "show-place-plain")).toThrow("nothing to press");
    expect(state().placing?.place).toEqual(AT);
    expect(state().view.fits).toBe(1);
    expect([...worthSeeing(state(), new Poses(), [])]).toEqual([toScene(10, -2, 0), toScene(10, 2, 0)]);
  });

  it("shows how far each vehicle is from its pad, the farthest first", async () => {
    const { state, actions } = await opened();
    const text = textOf(shows(state(), actions));
    expect(text.indexOf("placing-vehicle-d2")).toBeLessThan(text.indexOf("placing-vehicle-d1"));
    expect(text).toContain("1.50 m");
    expect(text).toContain(texts.placing.noPosition);
    expect(textOf(placingBar(state(), actions))).toContain("1.50 m at most");
  });

  it("is typed, moves at once, and is matched anew once it rests", async () => {
    const { state, actions, service, calls, dispatch } = await opened();
    press(shows(state(), actions), "placing-x", "change", { value: "11.5" });
    expect(padsOf(state().placing!)[0]).toEqual([11.5, -2]);
    expect(residual(beside(state(), state().placing!)).max_m).toBeCloseTo(1.5); // d1 now
    press(shows(state(), actions), "placing-x", "change", { value: "" });
    expect(state().placing!.place.x_m).toBe(11.5);
    const read = createReader(service);
    dispatch({ kind: "frame", frame: { ...STANDING, received_ms: 650 } });
    dispatch({ kind: "tick", now_ms: 650 });
    read(state());
    read(state());
    await settled();
    expect(calls.filter((each) => each.call.endsWith("/placement"))).toEqual([
      { call: "GET /api/v1/shows/{name}/placement", query: { x_m: 11.5, y_m: 0, turn_deg: 0 }, body: undefined },
    ]);
    expect(state().placing!.found.x_m).toBe(11.5);
  });

  it("turns about the middle of the pads", async () => {
    const { state, actions } = await opened();
    const before = middleOf(padsOf(state().placing!));
    press(shows(state(), actions), "placing-turn", "change", { value: "90" });
    const placing = state().placing!;
    expect(placing.place.turn_deg).toBe(90);
    expect(middleOf(padsOf(placing)).map((each, k) => Math.abs(each - before[k]!))).toEqual([expect.closeTo(0, 2), expect.closeTo(0, 2)]);
    expect(padsOf(placing)[0]!).toEqual([expect.closeTo(12), expect.closeTo(0)]); // from the left to the front: clockwise
    expect(turnedTo(placing, 270).turn_deg).toBe(-90);
  });

  it("is fitted by the service, and applied as a new version that is checked", async () => {
    const { state, actions, calls } = await opened({ put: { ...BEST, stored: BEST } });
    press(placingBar(state(), actions), "placing-apply");
    expect(state().toasts.at(-1)?.text).toContain(texts.placing.unchanged);
    press(placingBar(state(), actions), "placing-fit");
    expect(textOf(placingBar(state(), actions))).toContain(texts.placing.busy.fit);
    await settled();
    expect(state().placing?.place).toEqual({ x_m: 10.75, y_m: 0, turn_deg: 20.5 });
    expect(isChanged(state().placing!)).toBe(true);
    press(placingBar(state(), actions), "placing-apply");
    await settled();
    expect(calls.map((each) => each.call)).toEqual([
      "GET /api/v1/shows/{name}/placement", "PUT /api/v1/shows/{name}/placement", "POST /api/v1/shows/{name}/check", "GET /api/v1/shows",
      "GET /api/v1/shows/{name}/check",
    ]);
    expect(calls[1]!.body).toEqual({ x_m: 10.75, y_m: 0, turn_deg: 20.5 });
    expect(isChanged(state().placing!)).toBe(false);
  });

  it("is checked again once the check of the version before has ended", async () => {
    const { state, actions, calls, dispatch } = await opened({ put: { ...BEST, stored: BEST } });
    dispatch({ kind: "check", check: { ...CHECK, state: "running" } });
    actions.placeAt({ ...AT, x_m: 12 });
    press(placingBar(state(), actions), "placing-apply");
    await new Promise((resolve) => setTimeout(resolve, 700));
    const checks = calls.map((each) => each.call).filter((each) => each.endsWith("/check"));
    expect(checks.indexOf("GET /api/v1/shows/{name}/check")).toBeLessThan(checks.indexOf("POST /api/v1/shows/{name}/check"));
  });

  it("says why it was refused, and stays", async () => {
    const { state, actions } = await opened();
    actions.placeAt({ ...AT, y_m: 3 });
    press(placingBar(state(), actions), "placing-apply");
    await settled();
    expect(state().toasts.at(-1)?.text).toContain("no show 'night'");
    expect([state().placing?.place.y_m, state().placing?.busy]).toEqual([3, ""]);
  });

  it("is closed by a press and when the fleet starts; a late answer does not open it again", async () => {
    const { state, actions, dispatch } = await opened();
    const { found } = state().placing!;
    press(placingBar(state(), actions), "placing-close");
    expect(state().placing).toBeNull();
    dispatch({ kind: "placing", found, asked: AT });
    expect(state().placing).toBeNull();
    dispatch({ kind: "placing", found, asked: null });
    dispatch({ kind: "status", status: status() });
    expect(state().placing).toBeNull();
  });

  it("keeps what was moved while the service was asked", async () => {
    const { state, actions, dispatch } = await opened();
    actions.placeAt({ ...AT, x_m: 12 });
    dispatch({ kind: "placing", found: { ...PLACED, x_m: 11 }, asked: { ...AT, x_m: 11 } });
    expect(state().placing?.place.x_m).toBe(12);
    expect(padsOf(state().placing!)[1]![0]).toBeCloseTo(11);
  });
});

describe("pads in the scene", () => {
  const SCREEN: Screen = { width: 1200, height: 800, free: { left: 0, top: 0, width: 1200, height: 800 } };
  const SIGHT = { basis: basisOf(START), pose: START, screen: SCREEN };
  const rayAt = (x_m: number, y_m: number) => {
    const seen = project(SIGHT.basis, SIGHT.pose, SCREEN, toScene(x_m, y_m, 0))!;
    return { px: seen.px, py: seen.py, ray: rayThrough(SIGHT.basis, SIGHT.pose, SCREEN, seen.px, seen.py) };
  };
  const gripOn = (state: State, x_m: number, y_m: number) => {
    const { px, py, ray } = rayAt(x_m, y_m);
    return padGripAt(state, SIGHT, ray, px, py);
  };

  it("move with the hand that holds one of them", async () => {
    const { state } = await opened();
    expect(gripOn(state(), -40, 30)).toBeNull();
    const grip = gripOn(state(), 10, 2)!;
    expect(grip.kind).toBe("move");
    const place = padsMoved(grip, SIGHT, rayAt(6, -3).ray);
    expect([place.x_m, place.y_m, place.turn_deg]).toEqual([expect.closeTo(6, 0), expect.closeTo(-5, 0), 0]);
  });

  it("turn with the handle on their ring", async () => {
    const { state } = await opened();
    const [x, , z] = turnHandle(state().placing!);
    const grip = gripOn(state(), -z, x)!;
    expect(grip.kind).toBe("turn");
    const place = padsMoved(grip, SIGHT, rayAt(10, 20).ray); // from ahead to the right
    expect(place.turn_deg).toBeCloseTo(90, 0);
  });

  it("are not taken hold of without the right to operate, or while the service works", async () => {
    const { state, dispatch } = await opened();
    expect(gripOn({ ...state(), access: access(["watch"]) }, 10, 2)).toBeNull();
    dispatch({ kind: "placing-busy", busy: "fit" });
    expect(gripOn(state(), 10, 2)).toBeNull();
  });

  it("carry what is drawn with them", () => {
    const placing: Placing = { found: PLACED, place: { x_m: 0, y_m: 5, turn_deg: 90 }, changed_ms: 0, busy: "" };
    const [x, y] = carried([12, 0], placing.found.written, placing.place);
    expect([x, y]).toEqual([expect.closeTo(0), expect.closeTo(7)]);
  });
});
