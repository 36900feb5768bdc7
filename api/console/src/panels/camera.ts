/** How the scene is looked at: four cameras, and everything in the picture. Each button names its key. */

import { html, type TemplateResult } from "lit-html";
import type { Camera, State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { CAMERA_KEYS, FIT_KEY } from "../keys";

const t = texts.camera;

function choice(id: string, label: string, key: string, hint: string, pressed: boolean, press: () => void): TemplateResult {
  return html`<button
    type="button"
    class="choice"
    data-testid=${id}
    aria-keyshortcuts=${key}
    aria-pressed=${String(pressed)}
    title=${hint}
    @click=${press}
  >
    ${label}${keyHint(key)}
  </button>`;
}

/** Left out where there is no room for it; see scene.css. */
const keyHint = (key: string): TemplateResult => html`<span class="choice-key"> ${t.key(key.toUpperCase())}</span>`;

export function camera(state: State, actions: PanelActions): TemplateResult {
  const { view } = state;
  return html`<div class="camera" role="group" aria-label=${t.title} data-testid="camera">
    <div class="choices">
      ${Object.entries(CAMERA_KEYS).map(([key, value]: [string, Camera]) =>
        choice(`camera-${value}`, t.names[value], key, t.hints[value], value === view.camera, () => actions.view({ camera: value })),
      )}
    </div>
    <button
      type="button"
      class="choice fit"
      data-testid="camera-fit"
      aria-keyshortcuts=${FIT_KEY}
      title=${t.fitHint}
      @click=${() => actions.view({ fits: view.fits + 1 })}
    >
      ${t.fit}${keyHint(FIT_KEY)}
    </button>
  </div>`;
}
