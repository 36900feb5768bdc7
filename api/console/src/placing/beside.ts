/** A show that is being placed, beside the vehicles as they stand now. Pure. */

import { indexOf, type State } from "../state";
import { padsOf, type AtPad, type Placing } from "./model";

/** Each vehicle of the answer where it stands now, and how far from its pad. */
export function beside(state: State, placing: Placing): AtPad[] {
  const pads = padsOf(placing);
  return placing.found.vehicles.map(({ id, x_m, y_m, pad }, k) => {
    const row = state.status?.vehicles[k]?.id === id ? k : indexOf(state, id); // both are in the fleet's order
    const [now_x, now_y] = [state.frame?.x_m[row] ?? NaN, state.frame?.y_m[row] ?? NaN];
    const [x, y] = Number.isFinite(now_x + now_y) ? [now_x, now_y] : [x_m ?? NaN, y_m ?? NaN];
    const at = pad === null ? undefined : pads[pad];
    return { id, x_m: x, y_m: y, pad: pad ?? -1, off_m: at === undefined ? NaN : Math.hypot(x - at[0], y - at[1]) };
  });
}

/** The compass heading of the drawing's x axis. */
export function heading_deg(state: State, { place }: Placing): number {
  const heading = (state.status?.origin.heading_deg ?? 0) + place.turn_deg;
  return heading - 360 * Math.floor(heading / 360);
}
