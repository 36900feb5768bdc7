/** What may be pressed now; where not, why, in words. Pure. "" means that it may. */

import { whyNoFeature } from "../features";
import { airborne } from "./ground";
import { fresh, may, type Phase, type ShowAction, type State } from "../state";
import { texts } from "../texts";

export { airborne, whyNotOnGround } from "./ground";

export type VehicleAction = "hold" | "join" | "return" | "land" | "take-control" | "confirm-down" | "find";
export const VEHICLE_ACTIONS: readonly VehicleAction[] = ["hold", "join", "return", "land", "take-control", "confirm-down", "find"];

/** Phases in which the service accepts a command to one vehicle: gcs/model/lifecycle.py. The service decides. */
export const FROM: Record<VehicleAction, readonly Phase[]> = {
  hold: ["formation", "return", "landing"],
  join: ["hold"],
  return: ["hold", "formation", "landing"],
  land: ["takeoff", "hold", "formation", "return"],
  "take-control": ["pilot"],
  "confirm-down": ["lost", "killed"],
  find: ["standby"],
};

const EMERGENCY: readonly string[] = ["pause", "stop", "abort", "hold", "return", "land", "bring-home", "kill", "acknowledge"];

/** Commands that bring the fleet down are sent also with old data: the service decides by its own state. */
export function whyNot(state: State, action: string): string {
  const emergency = EMERGENCY.includes(action);
  if (state.status?.replay) return texts.flight.replay;
  if (state.access === null) return texts.flight.noRights;
  if (!may(state, emergency ? "emergency" : "operate")) {
    return may(state, "emergency") ? texts.flight.notOperate : texts.flight.watcher;
  }
  return emergency || fresh(state) ? "" : texts.flight.noData;
}

/** As for pausing: the right to pause the fleet includes acknowledging alarms. */
export function whyNotAcknowledge(state: State): string {
  return whyNot(state, "acknowledge");
}

const ON_THE_GROUND: readonly string[] = ["idle", "landed", "countdown"];

/** Why the service would refuse a start of all vehicles now, by its own look; "" where it would not, or flies. Pure. */
export function whyNoStart({ status }: State): string {
  return status !== null && ON_THE_GROUND.includes(status.show.phase) ? status.show.start_refused : "";
}

const BRINGING_DOWN: readonly ShowAction[] = ["pause", "stop", "abort"];

export function whyNotShow(state: State, action: ShowAction): string {
  const why = whyNot(state, action);
  if (why !== "" || state.status === null || !fresh(state)) return why;
  const { possible, phase } = state.status.show;
  const flying = airborne(state);
  if (flying > 0 && BRINGING_DOWN.includes(action)) return "";
  if (flying > 0 && action === "start") return texts.flight.airborne(flying);
  if (action === "start" && whyNoStart(state) !== "") return ""; // its sheet says why, and named vehicles may start
  return possible.includes(action) ? "" : texts.flight.notNow(texts.phases[phase]);
}

export function whyNotVehicle(state: State, action: VehicleAction, phase: Phase): string {
  const why = whyNot(state, action);
  if (why !== "" || !fresh(state)) return why;
  const lacks = whyNoFeature(state, action);
  if (lacks !== "") return lacks;
  return FROM[action].includes(phase) ? "" : texts.vehicle.notIn(texts.fleet.phases[phase]);
}

/** Formation, orbit and target belong to a written show as long as it is selected; a live cue takes the target. */
export function whyNotShape(state: State, what: "formation" | "orbit" | "target"): string {
  const why = whyNot(state, what);
  if (why !== "") return why;
  const selected = state.status?.show.selected;
  return !selected || (what === "target" && selected.target_is_live) ? "" : texts.shape.led(selected.name);
}
