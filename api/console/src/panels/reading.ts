/** Data that the stream lacks are requested while their panel is open: preflight, commands, delays of stations, show files. */

import type { Actions } from "../actions";
import { features } from "../features";
import { startOrder } from "./start";
import { same } from "../placing/model";
import { shownPanels } from "./layout";
import { whyNotOnGround } from "./rights";
import { fresh, type Placement, type State } from "../state";

const PREFLIGHT_MS = 2000;
const PREFLIGHT_UNSEEN_MS = 8000; // for the number beside its name
const ORDERS_MS = 2000;
const STATIONS_MS = 1000;
const FEATURES_MS = 1000;
const SITE_MS = 2000; // after a version that is not the one that was read
const MARKS_MS = 2000; // after an event
/** Pads that were moved are matched with the vehicles anew once they rest for so long. */
const PLACED_MS = 600;

/** Call it a few times a second. One request of a kind at a time, so that a slow service gets no more. */
export function createReader(service: Pick<Actions, "loadPreflight" | "loadOrders" | "loadStations" | "loadFeatures" | "loadPlacement" | "loadShows" | "loadMarks" | "loadSite">): (state: State) => void {
  const asked_ms = { preflight: -Infinity, commands: -Infinity, stations: -Infinity, features: -Infinity, marks: -Infinity, site: -Infinity };
  const busy = new Set<string>();
  let showsFor: string | null = null;
  let marksFor = "";
  let placedFor: Placement | null = null;

  function ask(what: string, call: () => Promise<unknown>): void {
    if (busy.has(what)) return;
    busy.add(what);
    void call().finally(() => busy.delete(what));
  }

  return (state) => {
    const { panels, page_ms, status } = state;
    if (!fresh(state) || !status || state.access === null) return;
    const marks = `${status.began_unix_time_s} ${status.replay ? "" : (status.events.at(-1)?.number ?? 0)}`;
    if (marks !== marksFor && page_ms - asked_ms.marks >= MARKS_MS) {
      asked_ms.marks = page_ms;
      marksFor = marks;
      ask("marks", service.loadMarks);
    }
    if (status.replay) return;
    const { left, right } = shownPanels(panels);
    const isLooking = left === "preflight" || panels.sheet === "start";
    const onGround = whyNotOnGround(state) === "";
    if (onGround && page_ms - asked_ms.preflight >= (isLooking ? PREFLIGHT_MS : PREFLIGHT_UNSEEN_MS)) {
      asked_ms.preflight = page_ms;
      const command = panels.sheet === "start" ? startOrder(state) : null;
      const vehicles = command === null || typeof command === "string" ? null : command.vehicles;
      ask("preflight", () => service.loadPreflight(vehicles));
    }
    const ordersOpen = (right === "events" && panels.eventList === "commands") || right === "vehicle";
    if (ordersOpen && page_ms - asked_ms.commands >= ORDERS_MS) {
      asked_ms.commands = page_ms;
      ask("commands", service.loadOrders);
    }
    if (right === "stations" && page_ms - asked_ms.stations >= STATIONS_MS) {
      asked_ms.stations = page_ms;
      ask("stations", service.loadStations);
    }
    if (features.some((each) => each.isRead?.(status)) && page_ms - asked_ms.features >= FEATURES_MS) {
      asked_ms.features = page_ms;
      ask("features", service.loadFeatures);
    }
    const version = (state.features ?? status.features).site?.version;
    const isOtherSite = version !== undefined && (state.site.stored === null || (version !== "" && version !== state.site.stored.version));
    if (isOtherSite && page_ms - asked_ms.site >= SITE_MS) {
      asked_ms.site = page_ms;
      ask("site", service.loadSite);
    }
    const { placing } = state;
    const isResting = placing !== null && placing.busy === "" && page_ms - placing.changed_ms >= PLACED_MS;
    if (isResting && placing.place !== placedFor && !same(placing.place, placing.found)) {
      placedFor = placing.place; // once: a refusal is shown, and not asked for again
      ask("placement", () => service.loadPlacement(placing.found.show, placing.place, false));
    }
    if (left !== "shows") showsFor = null;
    else if (showsFor !== `${state.access.name} ${status.began_unix_time_s}`) {
      showsFor = `${state.access.name} ${status.began_unix_time_s}`;
      ask("shows", service.loadShows);
    }
  };
}
