/** The stations that fly one formation: which of them leads, which is not received; and taking the lead. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { State, Station, Status } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button } from "./controls";
import { seconds, UNKNOWN, withUnit } from "./format";
import { icon } from "./icons";
import { whyNot } from "./rights";

const t = texts.stations;

export function isSite(status: Status | null): boolean {
  return (status?.stations.length ?? 0) > 1;
}

/** Stations that are not received. Pure. */
export function missing(status: Status | null): readonly Station[] {
  return status?.stations.filter((each) => !each.received) ?? [];
}

export function isMissingStation(status: Status, name: string): boolean {
  return status.stations.some((each) => each.name === name && !each.received);
}

/** Why the station of this page may not take the lead now; "" where it may. Pure. */
export function whyNotLead(state: State): string {
  const own = state.status?.stations.find((each) => each.own);
  if (own === undefined) return t.none;
  return own.leads ? t.leadsAlready(own.name) : whyNot(state, "lead");
}

function condition(station: Station): TemplateResult {
  if (station.received) return html`<span class="card-state good">${icon("check")} ${station.own ? t.own : t.received}</span>`;
  return html`<strong class="card-state bad" data-testid="station-missing-${station.name}">
    ${icon("warning")} ${t.missing}, ${station.silent_s === null ? t.never : t.silent(seconds(station.silent_s))}
  </strong>`;
}

function card(actions: PanelActions, station: Station): TemplateResult {
  const { name, own, received, delay_s } = station;
  const fact = (what: keyof typeof t.rows, value: string): TemplateResult =>
    html`<div><dt>${t.rows[what]}</dt><dd data-testid="station-${name}-${what}">${value}</dd></div>`;
  const ids = (): string[] => (actions.now().status?.vehicles ?? []).filter((each) => each.station === name).map((each) => each.id);
  return html`<li class="card station ${received ? "" : "missing"}" data-testid="station-${name}">
    <header>
      ${icon("station")}
      <h3>${name}</h3>
      ${station.leads ? html`<span class="tag" data-testid="leads-${name}">${t.leads}</span>` : nothing}
      ${condition(station)}
    </header>
    <div class="card-facts">
      <dl class="value">
        ${fact("show", received ? texts.phases[station.show] : UNKNOWN)} ${fact("vehicles", String(station.vehicles))}
        ${own ? nothing : fact("delay", delay_s !== null && received ? withUnit(1000 * delay_s, "ms", 0) : UNKNOWN)}
      </dl>
      ${button(actions, {
        id: `station-select-${name}`,
        label: t.select,
        name: t.selectOf(name),
        kind: "quiet",
        press: () => actions.choose({ how: "only", ids: ids() }),
      })}
    </div>
  </li>`;
}

function lead(state: State, actions: PanelActions, all: readonly Station[]): TemplateResult {
  const own = all.find((each) => each.own)?.name ?? "";
  const leading = all.find((each) => each.leads)?.name ?? UNKNOWN;
  const why = whyNotLead(state);
  const isSure = state.panels.sure === "lead" && why === "";
  return html`<section class="lead" aria-label=${t.take}>
    <p class="dim">${isSure ? t.consequence(own, leading) : why || t.what}</p>
    <div class="buttons">
      ${button(actions, {
        id: "lead-take",
        label: isSure ? t.sure(own) : t.take,
        kind: isSure ? "danger" : "normal",
        why,
        press: () => (isSure ? actions.takeLead() : actions.set({ sure: "lead" })),
      })}
      ${isSure ? button(actions, { id: "lead-cancel", label: texts.shell.cancel, focus: true, press: () => actions.set({ sure: "" }) }) : nothing}
    </div>
  </section>`;
}

export function stations(state: State, actions: PanelActions): TemplateResult {
  const all = state.status?.stations ?? [];
  if (!isSite(state.status)) return html`<p class="empty">${t.none}</p>`;
  return html`<div class="stations" data-testid="stations">
    ${lead(state, actions, all)}
    <ul class="cards">
      ${all.map((each) => card(actions, each))}
    </ul>
  </div>`;
}
