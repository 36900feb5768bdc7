/** Whether all are on the ground; what is settled there and not in the air may be changed then. Pure. */

import type { State } from "../state";
import { texts } from "../texts";

/** Vehicles in the air, whoever controls them. */
export function airborne(state: State): number {
  return state.status?.counts.airborne ?? 0;
}

const ON_THE_GROUND: readonly string[] = ["idle", "countdown", "landed"];

/** What is settled before a start and not in the air. */
export function whyNotOnGround(state: State): string {
  const phase = state.status?.show.phase;
  if (phase === undefined) return "";
  if (!ON_THE_GROUND.includes(phase)) return texts.flight.notNow(texts.phases[phase]);
  return airborne(state) > 0 ? texts.flight.airborne(airborne(state)) : "";
}
