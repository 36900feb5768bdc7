// A proposed start, checklists and weather: what the page offers, and to which token.

import { describe, expect, it } from "vitest";

import { go, left_s, t, typedWeather, whyNotConfirm, whyNotEntered } from "../src/features/go";
import type { Features, State } from "../src/state";
import { frame } from "./frames";
import { access, live, page, settled } from "./pages";
import { press, textOf } from "./pressing";
import { status } from "./statuses";

type Go = NonNullable<Features["go"]>;

const PROPOSAL: NonNullable<Go["proposal"]> = {
  command_id: "o1", by: "alice", hash: "3f2a9c01b4de", until_unix_time_s: 1042.4, vehicles: 3, at_unix_time_s: null,
};
const GO: Go = {
  confirmed_by_another: true, within_s: 60, proposal: PROPOSAL, ended: "", hashes: {}, start: null, missing: ["checklist pads: 1 of 2 items are open"], decides: true,
  checklists: [{ role: "pads", items: [{ text: "on its pad", by: "bob", unix_time_s: 1000 }, { text: "no person near", by: "", unix_time_s: null }] }],
  weather: { wind_m_s: 4, gust_m_s: null, visibility_m: 9000, kp: 2, by: "dana", unix_time_s: 990 },
};

function state(change: Partial<Go> = {}, now_s = 1000): State {
  return live({
    access: access(), frame: frame({ unix_time_s: now_s, vehicles: [{}] }), status: status({ features: { ...status().features, go: { ...GO, ...change } } }),
  });
}

const over = (first: State) => page(first, () => ({}), "refused");

describe("a proposed start", () => {
  it("says by which token, how long it waits, and its hash", () => {
    const { actions } = over(state());
    const text = textOf(go.strip!(state(), actions, ""));
    for (const each of ["Start proposed by alice", "43 s left", "hash 3f2a9c01b4de"]) expect(text).toContain(each);
    expect(left_s(PROPOSAL, 2000)).toBe(0);
    expect(go.strip!(state({ proposal: null }), actions, "")).toBeNull();
  });

  it("takes two presses, and its hash is sent", async () => {
    const { actions, calls, state: now } = over(state());
    press(go.strip!(now(), actions, ""), "go-confirm");
    expect(calls).toEqual([]);
    press(go.strip!(now(), actions, ""), "go-confirm");
    await settled();
    expect(calls[0]).toMatchObject({ call: "POST /api/v1/show/confirm", body: { hash: PROPOSAL.hash } });
  });

  it("is confirmed by another token, in time", () => {
    const own = { ...state(), access: { ...access(), name: "alice" } };
    expect(whyNotConfirm(state(), PROPOSAL, "")).toBe("");
    expect(whyNotConfirm(own, PROPOSAL, "")).toBe(t.own);
    expect(whyNotConfirm(state({}, 1043), PROPOSAL, "")).toBe(t.over);
    expect(whyNotConfirm(state(), PROPOSAL, "watches only")).toBe("watches only");
  });
});

describe("checklists and weather", () => {
  it("say NO GO and why, and how a proposed start ended", () => {
    const { actions } = over(state());
    const text = textOf(go.panel!.view(state({ ended: "its 60 s are over" }), actions, ""));
    for (const each of [t.noGo, "checklist pads: 1 of 2 items are open", "The proposed start is over: its 60 s are over."]) expect(text).toContain(each);
    expect(textOf(go.panel!.view(state({ missing: [] }), actions, ""))).not.toContain(t.noGo);
  });

  it("have a button for each item, and the names of those that signed", () => {
    const { actions } = over(state());
    const text = textOf(go.panel!.view(state(), actions, ""));
    for (const each of ["1 of 2 open", "on its pad", "bob", "Sign", "Open again", "Entered by dana"]) expect(text).toContain(each);
  });

  it("sends the numbers that are typed, and no others", () => {
    const typed = (drafts: Record<string, string>): State => ({ ...state(), panels: { ...state().panels, drafts } });
    expect(typedWeather(typed({}))).toEqual({});
    expect(whyNotEntered(typed({}))).toBe(t.noWeather);
    expect(whyNotEntered(typed({ "weather:wind_m_s": "4.5", "weather:kp": "x" }))).toBe("Kp: type a number");
    expect(whyNotEntered(typed({ "weather:wind_m_s": "4.5", "weather:kp": "" }))).toBe("");
    expect(typedWeather(typed({ "weather:wind_m_s": "4.5", "weather:kp": "x", "formation:radius_m": "9" }))).toEqual({ wind_m_s: 4.5 });
  });
});
