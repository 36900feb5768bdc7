// Executes the action of a key; `keys.ts` defines it.

import { command } from "./keys";
import type { PanelActions } from "./panels/actions";
import { pressBig } from "./panels/flight";
import { whyNotPreview } from "./panels/preview";
import { jumped_s, played } from "./replay/bar";
import type { State } from "./state";
import { texts } from "./texts";

export function onKey(event: KeyboardEvent, state: State, actions: PanelActions): void {
  const where = event.target instanceof Element ? event.target : null;
  const meant = event.defaultPrevented
    ? null
    : command({
        key: event.key,
        shift: event.shiftKey,
        other: event.ctrlKey || event.altKey || event.metaKey,
        typing: where?.matches("input:not([type=range]), textarea, select") ?? false,
        onControl: where?.matches("button, a, summary, input, .table-scroll, [role=listbox]") ?? false,
      });
  if (meant === null || (event.repeat && meant.kind !== "jump")) return;
  const replay = state.status?.replay;
  switch (meant.kind) {
    case "flight":
      if (state.connection.kind !== "denied" && !replay) pressBig(state, actions, meant.action);
      break;
    case "camera":
      actions.view({ camera: meant.camera });
      break;
    case "fit":
      actions.view({ fits: state.view.fits + 1 });
      break;
    case "panel":
      actions.togglePanel(meant.panel);
      focusNext(`[data-testid="panel-${meant.panel}"] :is(.panel-body[tabindex], .table-scroll, [role=listbox])`);
      break;
    case "night":
      actions.view({ night: !state.view.night });
      break;
    case "help":
      actions.sheet("help");
      break;
    case "filter":
      actions.openPanel("fleet");
      focusNext('[data-testid="filter"]');
      break;
    case "confirm":
      if (state.preview === null && state.panels.editing === null) return;
      if (whyNotPreview(state) === "") actions.confirmPreview();
      else actions.refuse(texts.preview.confirm, whyNotPreview(state));
      break;
    case "close":
      close(state, actions);
      break;
    case "play":
      if (!replay) return;
      actions.replay(played(replay));
      break;
    case "jump":
      if (!replay) return;
      actions.replay({ position_s: jumped_s(state, meant.by_s) });
  }
  event.preventDefault();
}

/** Once it is drawn; what a key has closed is not there. */
function focusNext(selector: string): void {
  requestAnimationFrame(() => document.querySelector<HTMLElement>(selector)?.focus());
}

/** One thing at a time, the foremost first. */
function close(state: State, actions: PanelActions): void {
  if (state.preview !== null) actions.cancelPreview();
  else if (state.panels.sheet !== null) actions.sheet(null);
  else if (state.panels.allAlarms) actions.set({ allAlarms: false });
  else if (state.panels.editing !== null) actions.edit(null);
  else if (state.panels.excluding !== null) actions.set({ excluding: null });
  else if (state.placing !== null) actions.closePlacing();
  else if (state.view.selection.length > 0) actions.choose({ how: "only", ids: [] });
}
