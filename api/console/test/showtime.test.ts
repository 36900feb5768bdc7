// When the show begins, and the timecode that it follows.

import { describe, expect, it } from "vitest";

import type { Actions } from "../src/actions";
import { apart, catchesUp, t, timecode } from "../src/features/timecode";
import { beginOrder, beginStrip, beginTime, whyNotBegin } from "../src/panels/begin";
import { utcTime } from "../src/panels/format";
import { whyNotStart } from "../src/panels/start";
import { topbar } from "../src/panels/topbar";
import type { Features, State, Status } from "../src/state";
import { texts } from "../src/texts";
import { frame } from "./frames";
import { access, live, panelsOver } from "./pages";
import { press, textOf } from "./pressing";
import { GROUNDED, status } from "./statuses";

const NOW_S = new Date(2026, 10, 26, 21, 25, 48).getTime() / 1000;
const AT_S = NOW_S + 252; // 21:30:00
const SHOW: NonNullable<Status["show"]["selected"]> = {
  name: "circle", hash: "ab", cue: "stand", cues: ["stand"], clock_s: 0, duration_s: 60, runs: false, target_is_live: false,
  track_rms_m: null, track_max_m: null, spares: [], begin: null, begun: false,
};
type Timecode = NonNullable<Features["timecode"]>;
const CODE: Timecode = {
  source: "rtp-midi://0.0.0.0:5004", followed: true, state: "running", label: "01:00:02:12", frame_rate: "25", age_s: 0.01, behind_s: 0.012,
  slope: 1, tempo: 1, problem: "", readings: 80, garbage: 0, dropped: 0, frozen_since_unix_time_s: null,
};
type Begin = NonNullable<typeof SHOW.begin>;
const armed: Begin = { state: "armed", at_unix_time_s: AT_S, in_s: 252 };

interface Given {
  begin?: Begin | null;
  begun?: boolean;
  phase?: Status["show"]["phase"];
  timecode?: Timecode | null;
  drafts?: Record<string, string>;
  beginAt?: boolean;
  stations?: number;
  code?: readonly [number, number, number, number];
  behind_s?: number;
}

function state(given: Given = {}): State {
  const { begin = null, begun = false, phase = "assembling", timecode = null } = given;
  const state = live();
  const station = { name: "north", own: true, leads: true, received: true, silent_s: 0, show: phase, vehicles: 1, delay_s: 0, term: 1, offers: [] };
  return {
    ...state,
    frame: frame({ unix_time_s: NOW_S, vehicles: [{}], ...(given.code && { label: given.code }), ...(given.behind_s && { behind_s: given.behind_s }) }),
    status: status({
      features: { ...status().features, timecode }, stations: Array(given.stations ?? 0).fill(station),
      ...(phase === "idle" && { counts: GROUNDED }), show: { ...status().show, phase, possible: ["start"], selected: { ...SHOW, begin, begun } },
    }),
    panels: { ...state.panels, drafts: given.drafts ?? {}, beginAt: given.beginAt ?? false },
  };
}

/** What the service is asked is kept. */
function asking(first: State, refuses: readonly string[] = []) {
  const asked: unknown[] = [];
  const call = (name: string) => (...given: unknown[]) => (asked.push([name, ...given]), Promise.resolve(!refuses.includes(name)));
  const names = ["begin", "cancelBegin", "ask", "start"] as const;
  return { asked, ...panelsOver(first, () => Object.fromEntries(names.map((name) => [name, call(name)])) as unknown as Actions) };
}

const pressed = () => new Promise((resolve) => setTimeout(resolve));

describe("a time to begin", () => {
  it("is the next such time of the local clock, and is sent in UTC", () => {
    expect(beginTime("21:30:00", NOW_S)).toBe(AT_S);
    expect(beginTime("00:10:00", NOW_S)).toBe(new Date(2026, 10, 27, 0, 10, 0).getTime() / 1000);
    expect(utcTime(AT_S)).toBe(new Date(AT_S * 1000).toUTCString().slice(17, 25));
  });

  it("is refused with its reason where it has passed, is too far ahead, or is none", () => {
    expect(beginTime("21:25:40", NOW_S)).toBe("21:25:40 has passed 0:08 ago, and is next in 23:59:52: give a time of the next 12 hours");
    expect(beginTime("09:30", NOW_S)).toContain("is next in 12:04:12");
    expect(beginTime("soon", NOW_S)).toBe(texts.begin.badTime);
    expect(whyNotBegin(state({ drafts: { "begin-time": "21:25:40" } }))).toContain("has passed");
    expect(whyNotBegin(state({ drafts: { "begin-time": "21:30:00" } }))).toBe("");
  });

  it("cannot be given to a show that has begun, or follows timecode; of a site it can", () => {
    const drafts = { "begin-time": "21:30:00" };
    expect(whyNotBegin(state({ drafts, begun: true }))).toBe(texts.begin.begun);
    expect(whyNotBegin(state({ drafts, timecode: CODE }))).toBe(t.begins);
    expect(whyNotBegin(state({ drafts, timecode: { ...CODE, followed: false } }))).toBe("");
    expect(whyNotBegin(state({ drafts, stations: 2 }))).toBe("");
    expect(whyNotBegin({ ...state({ drafts }), access: access(["watch"]) })).toBe(texts.flight.watcher);
  });

  it("is ordered by the start before it takes off; without it there is no take-off", async () => {
    const ready = state({ phase: "idle", beginAt: true, drafts: { "begin-time": "21:30:00" } });
    const good = asking(ready);
    good.actions.start();
    await pressed();
    expect(good.asked).toEqual([["begin", AT_S], ["start", null, null]]);
    expect([good.state().panels.beginAt, good.state().panels.drafts]).toEqual([false, {}]);
    const refused = asking(ready, ["begin"]);
    refused.actions.start();
    await pressed();
    expect(refused.asked).toEqual([["begin", AT_S]]);
    expect(beginOrder(state({ phase: "idle", beginAt: true, begin: armed }))).toBeNull(); // it has one already
  });

  it("keeps the start from taking off while it is none, or before the take-off", () => {
    const given = { phase: "idle" as const, beginAt: true };
    expect(whyNotStart(state({ ...given, drafts: { "begin-time": "21:25:40" } }))).toContain("has passed");
    const late = state({ ...given, drafts: { "begin-time": "21:30:00", "start-time": "21:31" } });
    expect(whyNotStart({ ...late, panels: { ...late.panels, startAt: true } })).toBe(texts.begin.beforeTakeOff);
  });
});

describe("a show that waits", () => {
  const strip = (given: Given) => textOf(beginStrip(state(given), asking(state(given)).actions));

  it("says which show, when and how long until then", () => {
    const text = strip({ begin: armed });
    for (const part of ["circle begins at 21:30:00", `${utcTime(AT_S)} UTC`, "in 4:12", texts.begin.states.armed]) expect(text).toContain(part);
    expect(strip({ begin: { ...armed, state: "waiting" } })).toContain(texts.begin.states.waiting);
    expect(strip({ begin: { state: "late", at_unix_time_s: NOW_S - 7, in_s: -7 } })).toContain("0:07 late");
    expect(strip({ begin: { state: "held", at_unix_time_s: null, in_s: null } })).toContain(texts.begin.states.held);
    expect(strip({ begin: null })).toContain("as soon as all vehicles are there");
  });

  it("says nothing of a show on the ground without a time, of one that has begun, or of one that follows timecode", () => {
    expect(strip({ phase: "idle" })).not.toContain("begins");
    expect(strip({ phase: "idle", begin: armed })).toContain("begins-in");
    expect(strip({ begun: true, phase: "running" })).not.toContain("begins");
    expect(strip({ timecode: CODE })).not.toContain("begins");
  });

  it("is cancelled with the second press, after what follows was named", () => {
    const ui = asking(state({ begin: armed }));
    const click = (): void => press(beginStrip(ui.state(), ui.actions), "begin-cancel");
    click();
    expect(ui.asked).toEqual([]);
    expect(textOf(beginStrip(ui.state(), ui.actions))).toContain(texts.begin.sureInTheAir);
    click();
    expect(ui.asked).toEqual([["cancelBegin"]]);
    const grounded = state({ begin: armed, phase: "idle" });
    const sure = { ...grounded, panels: { ...grounded.panels, sure: `begin:${AT_S}` } };
    expect(textOf(beginStrip(sure, ui.actions))).toContain(texts.begin.sureOnGround);
  });
});

describe("timecode", () => {
  const strip = (given: Given) => textOf(timecode.strip!(state(given), asking(state(given)).actions, ""));
  const lost: Timecode = { ...CODE, state: "lost", problem: "no timecode arrives any more", frozen_since_unix_time_s: NOW_S - 12 };

  it("is shown with its source, state and time, and how the show stands to it", () => {
    const text = strip({ phase: "running", begun: true, timecode: CODE, code: [1, 0, 2, 12], behind_s: 0.012 });
    for (const part of ["01:00:02:12", "rtp-midi://0.0.0.0:5004", "running", "show 12 ms behind"]) expect(text).toContain(part);
    expect(text).not.toContain(t.frozen);
    expect([apart(-0.25), apart(1.25), apart(NaN)]).toEqual(["show 250 ms ahead", "show 1.3 s behind", ""]);
    expect([catchesUp(1.1), catchesUp(1.004), catchesUp(NaN)]).toEqual(["at 1.10 of its speed", "", ""]);
    expect(strip({ timecode: null })).not.toContain("timecode");
  });

  it("says since when a show is frozen, and why; red where timecode is lost", () => {
    const frozen = { phase: "running" as const, begun: true };
    const text = strip({ ...frozen, timecode: lost });
    for (const part of [t.frozen, "12 s", "timecode lost since 21:25:36", "timecode-strip missing", "LOST"]) expect(text).toContain(part);
    const stopped = strip({ ...frozen, timecode: { ...lost, state: "stopped", problem: "the timecode has stopped" } });
    for (const part of [t.frozen, "timecode stopped since", "timecode-strip frozen"]) expect(stopped).toContain(part);
    const now = state({ ...frozen, timecode: lost });
    expect(textOf(topbar(now, asking(now).actions))).toContain(`>${t.phase}<`);
  });

  it("says why a show waits for it, and that it is not followed", () => {
    const problem = "the timecode comes to where the show is in 12 s";
    expect(strip({ timecode: { ...CODE, problem } })).toContain(`The show waits: ${problem}`);
    expect(strip({ timecode: { ...CODE, followed: false } })).toContain(t.notFollowed);
  });

  it("is let go with the second press where the show is frozen", () => {
    const ui = asking(state({ phase: "running", begun: true, timecode: lost }));
    const click = (): void => press(timecode.strip!(ui.state(), ui.actions, ""), "follow");
    click();
    expect(ui.asked).toEqual([]);
    click();
    expect(ui.asked).toEqual([["ask", t.title, expect.any(Function), t.letGo]]);
  });
});
