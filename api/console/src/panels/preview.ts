/** What was dragged and is not sent yet: confirm or discard it. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { Preview, State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button } from "./controls";
import { withUnit } from "./format";
import { icon } from "./icons";
import { whyNot, whyNotShape } from "./rights";

const t = texts.preview;

export function previewText(preview: Preview): string {
  const m = (value: number): string => withUnit(value, "m");
  switch (preview.kind) {
    case "target":
      return t.target(m(preview.x_m), m(preview.y_m));
    case "obstacle":
      return t.obstacle(preview.id, m(preview.x_m), m(preview.y_m));
    case "new-obstacle":
      return t.newObstacle(m(preview.x_m), m(preview.y_m));
    case "radius":
      return t.radius(m(preview.radius_m));
  }
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
  if (state.preview === null) return nothing;
  return html`<section class="preview-bar" role="alertdialog" aria-label=${previewText(state.preview)} data-testid="preview">
    ${icon("info")}
    <span><strong data-testid="preview-text">${previewText(state.preview)}</strong><small>${t.what}</small></span>
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
