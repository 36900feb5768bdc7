/** The placement of a drawn show: numbers and each vehicle's distance in the panel, what to do with it in a bar. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PanelActions } from "../panels/actions";
import { button } from "../panels/controls";
import { fixed, UNKNOWN, withUnit } from "../panels/format";
import { icon } from "../panels/icons";
import { whyNot, whyNotOnGround } from "../panels/rights";
import type { Placement, State } from "../state";
import { texts } from "../texts";
import { beside, heading_deg } from "./beside";
import { isChanged, OFF_M, residual, turnedTo, type AtPad, type Placing } from "./model";

const t = texts.placing;
const LISTED = 100; // vehicles, the farthest from their pads

/** Why the pads cannot be moved now; "" where they can. */
export function whyNotPlacing(state: State): string {
  return whyNot(state, "shows") || whyNotOnGround(state);
}

export function whyNotApply(state: State): string {
  const { placing } = state;
  if (placing === null) return t.none;
  const why = whyNotPlacing(state);
  if (why !== "") return why;
  if (placing.busy !== "") return t.busy[placing.busy];
  return isChanged(placing) ? "" : t.unchanged;
}

function whyNotFit(state: State): string {
  const { placing } = state;
  if (placing === null) return t.none;
  return whyNotPlacing(state) || (placing.busy === "" ? "" : t.busy[placing.busy]);
}

interface NumberInput {
  id: string;
  label: string;
  unit: string;
  value: number;
  step: number;
  set: (value: number) => Placement;
}

/** A field of numbers that arrow keys change, too. */
function field(actions: PanelActions, f: NumberInput): TemplateResult {
  const changed = (event: Event): void => {
    const value = Number.parseFloat((event.target as HTMLInputElement).value);
    if (Number.isFinite(value)) actions.placeAt(f.set(value));
  };
  return html`<label class="field">
    <span class="field-name">${f.label}</span>
    <span class="field-box">
      <input type="number" step=${f.step} autocomplete="off" data-testid=${f.id} .value=${String(f.value)} @change=${changed} />
      <span class="unit">${f.unit}</span>
    </span>
  </label>`;
}

function vehicle(at: AtPad): TemplateResult {
  const isOff = at.off_m > OFF_M;
  return html`<tr class=${isOff ? "off" : ""} data-testid="placing-vehicle-${at.id}">
    <th scope="row">${at.id}</th>
    <td class="number">${at.pad < 0 ? UNKNOWN : at.pad + 1}</td>
    <td class="number">${isOff ? icon("warning") : nothing}${Number.isFinite(at.off_m) ? withUnit(at.off_m, "m", 2) : Number.isFinite(at.x_m) ? t.noPad : t.noPosition}</td>
  </tr>`;
}

/** In the panel of shows, above the files. */
export function placingPanel(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const { placing } = state;
  if (placing === null) return nothing;
  const { found, place } = placing;
  const all = beside(state, placing);
  const worstFirst = [...all].sort((a, b) => (Number.isFinite(b.off_m) ? b.off_m : -1) - (Number.isFinite(a.off_m) ? a.off_m : -1));
  const pair = (id: string, name: string, value: string): TemplateResult => html`<div><dt>${name}</dt><dd class="value" data-testid=${id}>${value}</dd></div>`;
  const { rms_m, max_m } = residual(all);
  return html`<section class="placing group" aria-label=${t.title(found.show)} data-testid="placing-panel">
    <h3>${t.title(found.show)}</h3>
    <p class="hint">${t.how}</p>
    <div class="fields">
      ${field(actions, { id: "placing-x", label: t.x, unit: "m", value: place.x_m, step: 0.1, set: (x_m) => ({ ...place, x_m }) })}
      ${field(actions, { id: "placing-y", label: t.y, unit: "m", value: place.y_m, step: 0.1, set: (y_m) => ({ ...place, y_m }) })}
      ${field(actions, { id: "placing-turn", label: t.turn, unit: "°", value: place.turn_deg, step: 0.5, set: (turn_deg) => turnedTo(placing, turn_deg) })}
    </div>
    <dl class="facts">
      ${pair("placing-heading", t.heading, withUnit(heading_deg(state, placing), "°"))}
      ${pair("placing-fence", t.fence, withUnit(found.fence_distance_m, "m"))}
      ${pair("placing-rms", t.rms, withUnit(rms_m, "m", 2))} ${pair("placing-max", t.max, withUnit(max_m, "m", 2))}
    </dl>
    <p class="hint">${found.assigned === "file" ? t.byFile : t.byNearest}${found.origin_changes ? ` ${t.originChanges}` : ""}</p>
    <table class="plain-table">
      <thead>
        <tr>
          <th scope="col">${t.vehicle}</th>
          <th scope="col">${t.pad}</th>
          <th scope="col">${t.off}</th>
        </tr>
      </thead>
      <tbody>
        ${worstFirst.slice(0, LISTED).map(vehicle)}
      </tbody>
    </table>
    ${all.length > LISTED ? html`<p class="hint">${texts.preflight.moreVehicles(all.length - LISTED)}</p>` : nothing}
  </section>`;
}

function summary(state: State, placing: Placing): TemplateResult {
  const { rms_m, max_m } = residual(beside(state, placing));
  const { x_m, y_m, turn_deg } = placing.place;
  const off = Number.isFinite(rms_m) ? t.offBy(withUnit(rms_m, "m", 2), withUnit(max_m, "m", 2)) : t.noneKnown;
  return html`<span class="placing-at">${t.at(fixed(x_m), fixed(y_m), fixed(turn_deg))}</span> ${off}`;
}

/** Below the scene, beside or in place of the preview. */
export function placingBar(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const { placing } = state;
  if (placing === null) return nothing;
  return html`<section class="replay placing-bar" aria-label=${t.bar} data-testid="placing">
    <div class="placing-words">
      <strong>${icon("info")} ${t.title(placing.found.show)}</strong>
      <span class="value" data-testid="placing-summary">${placing.busy === "" ? summary(state, placing) : t.busy[placing.busy]}</span>
    </div>
    ${button(actions, { id: "placing-fit", label: t.fit, why: whyNotFit(state), press: () => actions.fitPlacement() })}
    ${button(actions, { id: "placing-apply", label: t.apply, kind: "primary", why: whyNotApply(state), press: () => actions.applyPlacement() })}
    ${button(actions, { id: "placing-close", label: t.close, icon: "cross", iconOnly: true, press: () => actions.closePlacing() })}
  </section>`;
}
