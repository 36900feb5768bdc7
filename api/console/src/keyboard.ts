// Keys, besides Tab and Enter, which reach every button. What takes something from a flight takes no single key.

import type { Actions } from "./actions";
import type { Camera, State } from "./state";

const CAMERAS: Readonly<Record<string, Camera>> = { "1": "orbit", "2": "top", "3": "side", "4": "follow" };

/** Pause and come home need one key; land now and kill need their buttons. */
export function onKey(event: KeyboardEvent, state: State, actions: Actions): void {
  if (event.ctrlKey || event.altKey || event.metaKey || event.defaultPrevented) return;
  const where = event.target instanceof Element ? event.target : null;
  if (state.ghost !== null && event.key === "Escape") return actions.cancelGhost();
  if (where?.closest("input, select, textarea, dialog")) return;
  if (state.ghost !== null && event.key === "Enter" && !where?.closest("button, a, summary")) return void actions.confirmGhost();
  const camera = CAMERAS[event.key];
  if (camera !== undefined) return actions.dispatch({ kind: "view", change: { camera } });
  switch (event.key) {
    case "p":
      return void actions.show("pause");
    case "n":
      return actions.dispatch({ kind: "view", change: { night: !state.view.night } });
    case "?":
      return actions.dispatch({ kind: "view", change: { dialog: { kind: "help" } } });
    case "Escape":
      return actions.dispatch({ kind: "view", change: { dialog: null, selected: null } });
  }
}
