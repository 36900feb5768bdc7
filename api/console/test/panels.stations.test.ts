import { describe, expect, it } from "vitest";

import { isMissingStation, isSite, missing, whyNotLead } from "../src/panels/stations";
import { initial, type Right, type State, type Station } from "../src/state";
import { texts } from "../src/texts";
import { update } from "../src/update";
import { frame } from "./frames";
import { access, live } from "./pages";
import { status } from "./statuses";

const station = (name: string, change: Partial<Station> = {}): Station => ({
  name, own: false, leads: false, received: true, silent_s: 0.04, show: "running", vehicles: 2, delay_s: 0.004, term: 1, offers: [], ...change,
});
const SITE = [station("north", { own: true }), station("south", { leads: true }), station("west", { received: false, silent_s: 2 })];

/** At a console that may do everything, with fresh data. */
const at = (stations: Station[], rights?: Right[]): State =>
  live({ page_ms: 1000, access: access(rights), frame: frame({ vehicles: [{}] }, 900), status: status({ stations }) });

describe("stations", () => {
  it("are a site where there are several", () => {
    expect([isSite(null), isSite(status()), isSite(status({ stations: SITE }))]).toEqual([false, false, true]);
  });

  it("are missing where they are not received", () => {
    const found = status({ stations: SITE });
    expect(missing(found).map((each) => each.name)).toEqual(["west"]);
    expect(["north", "west", ""].map((name) => isMissingStation(found, name))).toEqual([false, true, false]);
    expect(missing(null)).toEqual([]);
  });

  it("take the place of those of the status", () => {
    const state = update(at(SITE), { kind: "stations", stations: [station("north", { own: true, leads: true })] });
    expect(state.status?.stations.map((each) => each.leads)).toEqual([true]);
    expect(update(initial(0), { kind: "stations", stations: SITE }).status).toBeNull();
  });

  it("have no panel once there is one station", () => {
    const open = update(at(SITE), { kind: "panels", change: { right: "stations" } });
    expect(update(open, { kind: "status", status: status({ stations: SITE }) }).panels.right).toBe("stations");
    expect(update(open, { kind: "status", status: status() }).panels.right).toBe("fleet");
  });
});

describe("the lead", () => {
  it("may be taken by the station of this page, by an operator", () => {
    expect(whyNotLead(at(SITE))).toBe("");
    expect(whyNotLead(at(SITE, ["watch"]))).toBe(texts.flight.watcher);
    expect(whyNotLead(at(SITE, ["watch", "emergency"]))).toBe(texts.flight.notOperate);
    expect(whyNotLead({ ...at(SITE), page_ms: 9000 })).toBe(texts.flight.noData);
  });

  it("is not taken twice, nor where there is one station", () => {
    expect(whyNotLead(at([station("north", { own: true, leads: true }), station("south")]))).toBe(texts.stations.leadsAlready("north"));
    expect(whyNotLead(at([]))).toBe(texts.stations.none);
  });

  it("asks again for a second press once it was taken", () => {
    const sure = update(at(SITE), { kind: "panels", change: { sure: "lead" } });
    expect(update(sure, { kind: "status", status: status({ stations: SITE }) }).panels.sure).toBe("lead");
    const leads = [station("north", { own: true, leads: true }), station("south")];
    expect(update(sure, { kind: "status", status: status({ stations: leads }) }).panels.sure).toBe("");
  });
});
