/** One vehicle: all its values, and the commands it accepts. */

import { html, nothing, type TemplateResult } from "lit-html";
import { FLAG, indexOf, type State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button } from "./controls";
import { fixed, measured, percent, UNKNOWN, withUnit } from "./format";
import { group, lastOrder } from "./group";
import { roughly } from "./energy";
import { icon, PHASE_ICON, type IconName } from "./icons";
import { VEHICLE_ACTIONS, whyNotVehicle, type VehicleAction } from "./rights";
import { alarmsByVehicle, isStale, rowOf, type Row } from "./rows";
import { isMissingStation } from "./stations";

const ACTION_ICON: Record<VehicleAction, IconName> = {
  hold: "hold",
  join: "formation",
  return: "home",
  land: "land",
  "take-control": "pilot",
  "confirm-down": "check",
  find: "find",
};

const t = texts.vehicle;

function fact(name: string, label: string, value: unknown): TemplateResult {
  return html`<div><dt>${label}</dt><dd class="value" data-testid="vehicle-${name}">${value}</dd></div>`;
}

const pair = (name: keyof typeof t.rows, value: unknown): TemplateResult => fact(name, t.rows[name], value);

function place2(x_m: number | undefined, y_m: number | undefined): string {
  return Number.isFinite(x_m) ? `${fixed(x_m)}, ${fixed(y_m)} m` : UNKNOWN;
}

/** What a vehicle sends: it has none of it before it is received. */
const NEVER = ["position", "height", "velocity", "battery", "fix", "mode", "armed", "landed", "ready"] as const;

function facts(state: State, row: Row): TemplateResult {
  const frame = state.frame!;
  const status = state.status!;
  const vehicle = status.vehicles[row.index]!;
  const i = row.index;
  const speed = Math.hypot(frame.vx_m_s[i]!, frame.vy_m_s[i]!);
  const asked = Math.hypot(frame.setpoint_x_m_s[i]!, frame.setpoint_y_m_s[i]!);
  const isCommanded = (frame.flags[i]! & FLAG.commanded) !== 0;
  const equipment = html`${vehicle.station === null ? nothing : pair("station", vehicle.station)}
    ${pair("autopilot", vehicle.autopilot)} ${pair("link", `${vehicle.link}, ${vehicle.system_id}`)}`;
  if (!row.received) return html`<dl class="facts">${NEVER.map((name) => pair(name, t.notReceived))} ${equipment}</dl>`;
  const last = lastOrder(state, row.id);
  const part = last?.outcomes[row.id];
  const moving = (sideways: number, up: number): string =>
    Number.isFinite(sideways) ? `${fixed(sideways)}, ${fixed(up)} m/s` : UNKNOWN;
  return html`<dl class="facts">
    ${pair("position", place2(frame.x_m[i], frame.y_m[i]))}
    ${pair("height", withUnit(row.height_m, "m"))}
    ${pair("velocity", moving(speed, frame.vup_m_s[i]!))}
    ${pair("setpoint", isCommanded ? moving(asked, frame.setpoint_up_m_s[i]!) : t.notCommanded)}
    ${pair("heading", withUnit(frame.heading_deg[i], "°", 0))}
    ${pair("nearest", withUnit(row.nearest_m, "m"))}
    ${pair("home", place2(vehicle.home?.x_m, vehicle.home?.y_m))}
    ${pair("battery", percent(row.battery))}
    ${pair("left", left(state, row.id))}
    ${pair("fix", `${row.fix || UNKNOWN}, ${withUnit(row.fix_m, "m")}`)}
    ${status.columns.filter(({ label }) => label !== "").map(({ name, unit, label }) => fact(name, label, measured(frame[name][i], unit)))}
    ${pair("mode", row.mode)}
    ${pair("armed", row.armed ? t.yes : t.no)}
    ${pair("landed", t.landed[frame.landed[i]!] ?? UNKNOWN)}
    ${pair("ready", row.ready ? t.yes : t.no)}
    ${equipment}
    ${pair("commands", last ? `${texts.events.action(last.action)}, ${texts.events.outcomes[part!.outcome] ?? part!.outcome} ${part!.reason}` : UNKNOWN)}
  </dl>`;
}

/** How long its battery lasts; a dash while that is not known. */
function left({ frame, status }: State, id: string): string {
  const index = status?.vehicles.findIndex((each) => each.id === id) ?? -1;
  const [low_s, empty_s] = [frame?.low_s[index] ?? NaN, frame?.empty_s[index] ?? NaN];
  return Number.isFinite(low_s) ? `${roughly(low_s)}, ${roughly(empty_s)}` : UNKNOWN;
}

function commands(state: State, actions: PanelActions, row: Row): TemplateResult {
  return html`<div class="vehicle-commands">
    ${VEHICLE_ACTIONS.map((action) => {
      const why = whyNotVehicle(state, action, row.phase);
      return html`<div class="vehicle-command">
        ${button(actions, {
          id: `vehicle-${action}`,
          label: t.actions[action],
          name: texts.commands.vehicle(t.actions[action], row.id),
          icon: ACTION_ICON[action],
          why,
          press: () => actions.vehicle(row.id, action),
        })}
        <small>${why || t.actionHelp[action]}</small>
      </div>`;
    })}
  </div>`;
}

export function vehicle(state: State, actions: PanelActions): TemplateResult {
  const { status, frame } = state;
  const id = state.view.selected;
  if (state.view.selection.length > 1) return group(state, actions);
  if (id === null) return html`<p class="empty">${t.none}</p>`;
  const index = indexOf(state, id);
  if (!status || !frame || index < 0 || index >= frame.n) return html`<p class="empty">${t.gone(id)}</p>`;
  const row = rowOf(status, frame, state.panels.table.nearest_m, index, alarmsByVehicle(status));
  const { reason } = status.vehicles[index]!;
  return html`<article class="vehicle ${row.received && isStale(row) ? "old" : ""}" data-testid="vehicle-page">
    <header>
      <h3 data-testid="vehicle-id">${row.id}</h3>
      <span class="phase phase-${row.phase} value" data-testid="vehicle-phase">
        ${icon(PHASE_ICON[row.phase])}${texts.fleet.phases[row.phase]}
      </span>
      <span class="spring"></span>
      ${button(actions, {
        id: "vehicle-follow",
        label: t.follow,
        kind: "quiet",
        pressed: state.view.camera === "follow",
        press: () => actions.view({ camera: "follow" }),
      })}
    </header>
    ${reason ? html`<p class="value" data-testid="vehicle-reason">${reason}</p>` : nothing}
    ${isMissingStation(status, row.station)
      ? html`<p class="problem" data-testid="vehicle-station-missing">${icon("warning")} ${texts.stations.ofMissing(row.station)}</p>`
      : nothing}
    ${row.received && isStale(row) ? html`<p class="problem">${icon("warning")} ${texts.fleet.stale}</p>` : nothing}
    ${row.limited
      ? html`<p class="notice" data-testid="vehicle-limited">${icon("limited")} ${t.held}: ${row.limitedBy || texts.fleet.limited}</p>`
      : nothing}
    ${commands(state, actions, row)} ${facts(state, row)}
  </article>`;
}
