/** What was dragged and is not sent yet: confirm or discard it. */

import { html, nothing, type TemplateResult } from "lit-html";
import { editedBox, isUnplaced, NEW } from "../obstacle";
import type { Preview, Obstacle, State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button } from "./controls";
import { withUnit } from "./format";
import { icon } from "./icons";
import { shownPanels } from "./layout";
import { whyNot, whyNotShape } from "./rights";

const t = texts.preview;

export function previewText(preview: Preview): string {
  const m = (value: number): string => withUnit(value, "m");
  switch (preview.kind) {
    case "target":
      return t.target(m(preview.x_m), m(preview.y_m));
    case "radius":
      return t.radius(m(preview.radius_m));
  }
}

function boxText(box: Obstacle): string {
  const [x, y, wide, deep, high] = [box.x_m, box.y_m, 2 * box.half_length_x_m, 2 * box.half_length_y_m, box.height_m].map((each) => withUnit(each, "m"));
  return t.obstacle(box.id, x!, y!, texts.obstacles.size(wide!, deep!, high!));
}

export function whyNotPreview(state: State): string {
  switch (state.preview?.kind) {
    case "target":
      return whyNotShape(state, "target");
    case "radius":
      return whyNotShape(state, "formation");
    default:
      return whyNot(state, "obstacle");
  }
}

export function previewBar(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const box = shownPanels(state.panels).left === "obstacles" ? null : editedBox(state); // the form has buttons of its own
  if (state.preview === null && box === null) return nothing;
  const text = state.preview === null ? boxText(box!) : previewText(state.preview);
  return html`<section class="preview-bar" role="alertdialog" aria-label=${text} data-testid="preview">
    ${icon("info")}
    <span><strong data-testid="preview-text">${text}</strong><small>${box?.id === NEW && isUnplaced(state) ? texts.obstacles.place : t.what}</small></span>
    ${button(actions, {
      id: "preview-confirm",
      label: `${t.confirm} ⏎`,
      kind: "primary",
      icon: "check",
      why: whyNotPreview(state),
      press: () => actions.confirmPreview(),
    })}
    ${button(actions, { id: "preview-cancel", label: `${t.cancel} Esc`, press: () => actions.cancelPreview() })}
  </section>`;
}
