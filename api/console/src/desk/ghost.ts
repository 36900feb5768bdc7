/** What was dragged and is not ordered yet: confirm it or drop it. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { Ghost, State } from "../state";
import { texts } from "../texts";
import type { DeskActions } from "./actions";
import { button } from "./controls";
import { withUnit } from "./format";
import { icon } from "./icons";
import { whyNot, whyNotShape } from "./rights";

const t = texts.ghost;

export function ghostText(ghost: Ghost): string {
  const m = (value: number): string => withUnit(value, "m");
  switch (ghost.kind) {
    case "target":
      return t.target(m(ghost.x_m), m(ghost.y_m));
    case "obstacle":
      return t.obstacle(ghost.id, m(ghost.x_m), m(ghost.y_m));
    case "new-obstacle":
      return t.newObstacle(m(ghost.x_m), m(ghost.y_m));
    case "radius":
      return t.radius(m(ghost.radius_m));
  }
}

export function whyNotGhost(state: State): string {
  switch (state.ghost?.kind) {
    case "target":
      return whyNotShape(state, "target");
    case "radius":
      return whyNotShape(state, "formation");
    default:
      return whyNot(state, "obstacle");
  }
}

export function ghostBar(state: State, actions: DeskActions): TemplateResult | typeof nothing {
  if (state.ghost === null) return nothing;
  return html`<section class="ghost-bar" role="alertdialog" aria-label=${ghostText(state.ghost)} data-testid="ghost">
    ${icon("info")}
    <span><strong data-testid="ghost-text">${ghostText(state.ghost)}</strong><small>${t.what}</small></span>
    ${button(actions, {
      id: "ghost-confirm",
      label: `${t.confirm} ⏎`,

      kind: "primary",
      icon: "check",
      why: whyNotGhost(state),
      press: () => actions.confirmGhost(),
    })}
    ${button(actions, { id: "ghost-cancel", label: `${t.cancel} Esc`, press: () => actions.cancelGhost() })}
  </section>`;
}
