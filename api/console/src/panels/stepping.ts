/** The preflight panel comes and goes by itself: it opens when it keeps a start from happening, and makes room at take-off. Pure. */

import type { State } from "../state";
import { DEAD_IN_REPLAY } from "./layout";
import { preflightNow } from "./preflight";
import { whyNotOnGround } from "./rights";
import type { PanelState } from "./state";

/** With a new status: preflight closes as soon as the show has left the ground; a replay has no use for some panels. */
export function steppedBack(state: State): Partial<PanelState> {
  const { left, wasDown } = state.panels;
  const isDown = whyNotOnGround(state) === "";
  const takesOff = wasDown && !isDown && left === "preflight";
  const isDead = Boolean(state.status?.replay) && left !== null && DEAD_IN_REPLAY.has(left);
  return { wasDown: isDown, left: takesOff || isDead ? null : left };
}

/** While a start is prepared: preflight opens beside the dialog when it fails; a sheet would lie under the dialog. */
export function steppedForward(state: State): Partial<PanelState> {
  const report = preflightNow(state);
  const { sheet, layout } = state.panels;
  return sheet === "start" && layout === "wide" && report?.passes === false ? { left: "preflight" } : {};
}
