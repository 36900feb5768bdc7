/** The keys, and what the symbols mean. */

import { html, type TemplateResult } from "lit-html";
import { PHASES, type State } from "../state";
import { texts } from "../texts";
import { icon, PHASE_ICON, sceneForm } from "./icons";
import { CAMERA_KEYS, FIT_KEY, KEYS, PANEL_KEYS, type FlightKey } from "../keys";

const t = texts.help;

export function help(_state: State): TemplateResult {
  const key = (keys: readonly string[], what: string): TemplateResult =>
    html`<div><dt>${keys.map((each) => html`<kbd>${each}</kbd> `)}</dt><dd>${what}</dd></div>`;
  return html`<p>${t.everywhere}</p>
    <div class="columns">
      <section>
        <h3>${t.keys}</h3>
        <dl class="keys">
          ${(Object.keys(KEYS) as FlightKey[]).map((action) => key(["Shift", KEYS[action]], t.list[action]))}
          ${key(Object.keys(CAMERA_KEYS), t.list.camera)} ${key([FIT_KEY], t.list.fit)} ${key(["n"], t.list.night)}
          ${key(Object.keys(PANEL_KEYS), t.list.panels)} ${key(["/"], t.list.filter)}
          ${key(["Enter", "Esc"], t.list.confirm)} ${key(["Space"], t.list.play)} ${key([",", "."], t.list.jump)}
          ${key(["?"], t.list.help)}
        </dl>
      </section>
      <section>
        <h3>${t.symbols}</h3>
        <ul class="plain symbols">
          ${PHASES.map(
            (phase) => html`<li class="phase phase-${phase}">${icon(PHASE_ICON[phase])}${sceneForm(phase)}<span>${texts.fleet.phases[phase]}</span></li>`,
          )}
          <li>${icon("limited")}<span>${texts.fleet.columnHelp.held}</span></li>
        </ul>
        <p class="dim">${t.forms} ${t.colours}</p>
        <p class="dim">${t.stale}</p>
        <h3>${texts.fleet.filter}</h3>
        <p><code>${texts.fleet.filterHelp}</code></p>
        <h3>${t.mouse}</h3>
        <dl class="keys gestures">
          ${t.gestures.map(([gesture, what]) => html`<div><dt>${gesture}</dt><dd>${what}</dd></div>`)}
        </dl>
        <p class="dim">${t.camera}</p>
      </section>
    </div>`;
}
