/** The selection: its vehicles, what can be commanded to all of them at once, and what became of it. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { FleetCommand } from "../actions";
import { fresh, indexOf, PHASES, type Command, type Phase, type State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button } from "./controls";
import { outcome } from "./events";
import { percent, tail, withUnit } from "./format";
import { icon, PHASE_ICON, type IconName } from "./icons";
import { FROM, whyNot } from "./rights";

const t = texts.selection;
const LETTERS = 12;
const LISTED = 100; // vehicles: a thousand lines are not read

export const FLEET_COMMANDS: readonly FleetCommand[] = ["hold", "join", "return", "land", "take-control"];

const COMMAND_ICON: Record<FleetCommand, IconName> = {
  hold: "hold",
  join: "formation",
  return: "home",
  land: "land",
  "take-control": "pilot",
};

function phaseOf(state: State, id: string): Phase {
  return PHASES[state.frame?.phase[indexOf(state, id)] ?? 0] ?? "offline";
}

/** Why a command would reach none of the selection; "" where it reaches one at least. The service has the last word. Pure. */
export function whyNotSelection(state: State, command: FleetCommand): string {
  const why = whyNot(state, command);
  if (why !== "" || !fresh(state)) return why;
  const { selection } = state.view;
  if (selection.length === 0) return t.none;
  const phases = new Set(selection.map((id) => phaseOf(state, id)));
  if ([...phases].some((phase) => FROM[command].includes(phase))) return "";
  return texts.vehicle.notIn([...phases].map((phase) => texts.fleet.phases[phase]).join(", "));
}

/** The newest command that named this vehicle. Pure. */
export function lastOrder(state: State, id: string): Command | undefined {
  return state.commands.find((each) => id in each.outcomes);
}

function commands(state: State, actions: PanelActions, hasIcons: boolean): TemplateResult {
  return html`<div class="group-commands" role="group" aria-label=${t.commands}>
    ${FLEET_COMMANDS.map((command) =>
      button(actions, {
        id: `selection-${command}`,
        label: texts.vehicle.actions[command],
        name: t.commandTo(texts.vehicle.actions[command], state.view.selection.length),
        ...(hasIcons ? { icon: COMMAND_ICON[command] } : {}),
        why: whyNotSelection(state, command),
        press: () => actions.fleet(command),
      }),
    )}
  </div>`;
}

function head(state: State, actions: PanelActions): TemplateResult {
  return html`<header>
    <strong data-testid="selection-count">${t.count(state.view.selection.length)}</strong>
    <button type="button" class="link" data-testid="selection-open" @click=${() => actions.openPanel("vehicle")}>${t.open}</button>
    <span class="spring"></span>
    <button type="button" class="link" data-testid="selection-clear" @click=${() => actions.choose({ how: "only", ids: [] })}>${t.clear}</button>
  </header>`;
}

/** Below the table, as long as something is selected. */
export function selectionBar(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  if (state.view.selection.length === 0) return nothing;
  return html`<section class="selection-bar" aria-label=${t.title} data-testid="selection">${head(state, actions)} ${commands(state, actions, false)}</section>`;
}

function line(state: State, actions: PanelActions, id: string): TemplateResult {
  const index = indexOf(state, id);
  const phase = phaseOf(state, id);
  const command = lastOrder(state, id);
  const part = command?.outcomes[id];
  return html`<li class="selected-vehicle" data-testid="selected-${id}">
    <button type="button" class="link" title=${id} @click=${() => actions.select(id)}>${tail(id, LETTERS)}</button>
    <span class="phase phase-${phase} value">${icon(PHASE_ICON[phase])}<span>${texts.fleet.phases[phase]}</span></span>
    <span class="number value">${withUnit(state.frame?.height_m[index], "m")}</span>
    <span class="number value">${percent(state.frame?.battery[index])}</span>
    <span class="selected-command" data-testid="selected-command-${id}">
      ${command && part ? html`${outcome(part.outcome)} ${texts.events.action(command.action)} ${part.reason}` : nothing}
    </span>
    ${button(actions, {
      id: `deselect-${id}`,
      label: t.deselect(id),
      icon: "cross",
      iconOnly: true,
      kind: "quiet",
      press: () => actions.choose({ how: "toggle", id }),
    })}
  </li>`;
}

/** In place of one vehicle's page, where several are selected. */
export function group(state: State, actions: PanelActions): TemplateResult {
  const { selection } = state.view;
  return html`<article class="group-page" data-testid="group-page">
    <header>
      <h3 data-testid="group-count">${t.count(selection.length)}</h3>
      <span class="spring"></span>
      ${button(actions, { id: "group-clear", label: t.clear, kind: "quiet", press: () => actions.choose({ how: "only", ids: [] }) })}
    </header>
    ${commands(state, actions, true)}
    <ul class="plain">
      ${selection.slice(0, LISTED).map((id) => line(state, actions, id))}
    </ul>
    ${selection.length > LISTED ? html`<p class="dim">${texts.preflight.moreVehicles(selection.length - LISTED)}</p>` : nothing}
  </article>`;
}
