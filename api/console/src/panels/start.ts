/** The start: which show, which vehicles, when, and whether preflight passes. One press to open, one to take off. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { beginOrder, beginRow } from "./begin";
import { button, choices, textField } from "./controls";
import { clockTime, nextClockTime } from "./format";
import { icon } from "./icons";
import { failures, preflightOf } from "./preflight";
import { whyNotShow } from "./rights";

const t = texts.start;

export interface StartOrder {
  vehicles: readonly string[] | null; // null: all online
  at_unix_time_s: number | null; // null: now
}

const DAY_S = 86_400;

/** The start as typed; a text where it cannot be sent. Pure. */
export function startOrder(state: State): StartOrder | string {
  const { drafts, startAt, startNamed } = state.panels;
  const vehicles = startNamed ? names(drafts["start-names"] ?? "") : null;
  if (vehicles?.length === 0) return t.badNames;
  const now_s = state.frame?.unix_time_s ?? NaN;
  const at_unix_time_s = startAt ? nextClockTime(drafts["start-time"] ?? "", now_s) : null;
  if (startAt && at_unix_time_s === null) return t.badTime;
  return { vehicles, at_unix_time_s };
}

export function names(text: string): string[] {
  return [...new Set(text.split(/[\s,;]+/).filter((each) => each !== ""))];
}

/** Why pressing "Take off" would do nothing; "" where it may be pressed. A start by the clock is checked when it is due. Pure. */
export function whyNotStart(state: State): string {
  const command = startOrder(state);
  const why = whyNotShow(state, "start") || (typeof command === "string" ? command : "") || whyNotBegun(state, command);
  if (why !== "" || typeof command === "string" || command.at_unix_time_s !== null) return why;
  const report = preflightOf(state, command.vehicles);
  if (report === null) return state.panels.preflightProblem || t.unknown;
  if (!report.vehicles.some((each) => each.flies)) return t.noVehicles;
  return report.passes ? "" : t.fails(failures(report));
}

/** Why the time at which the show shall begin does not go with the start. */
function whyNotBegun(state: State, command: StartOrder | string): string {
  const begins = beginOrder(state);
  if (typeof begins === "string") return begins;
  const at_s = typeof command === "string" ? null : command.at_unix_time_s;
  return begins !== null && at_s !== null && begins <= at_s ? texts.begin.beforeTakeOff : "";
}

/** Vehicles with one reason together: "d1, d2: offline", in their order. Pure. */
export function byReason(reasons: Readonly<Record<string, string>>): { reason: string; vehicles: string[] }[] {
  const groups = new Map<string, string[]>();
  for (const [id, reason] of Object.entries(reasons)) groups.set(reason, [...(groups.get(reason) ?? []), id]);
  return [...groups].map(([reason, vehicles]) => ({ reason, vehicles }));
}

const NAMED_MAX = 8;

function named(vehicles: readonly string[]): string {
  if (vehicles.length <= NAMED_MAX) return vehicles.join(", ");
  return `${vehicles.slice(0, NAMED_MAX).join(", ")} ${texts.preflight.moreVehicles(vehicles.length - NAMED_MAX)}`;
}

function readiness(state: State, actions: PanelActions): TemplateResult {
  const command = startOrder(state);
  const report = preflightOf(state, typeof command === "string" ? null : command.vehicles);
  if (report === null) return html`<p class="verdict" data-testid="start-preflight">${icon("question")} ${state.panels.preflightProblem || t.unknown}</p>`;
  const flying = report.vehicles.filter((each) => each.flies).length;
  const passes = report.passes && flying > 0;
  const byClock = typeof command !== "string" && command.at_unix_time_s !== null;
  const verdict = flying === 0 ? t.noVehicles : passes ? t.passes : byClock ? t.failsNow(failures(report)) : t.fails(failures(report));
  const staying = byReason(report.not_flying);
  return html`<p class="verdict ${passes ? "good" : "bad"}" data-testid="start-preflight">
      ${icon(passes ? "check" : "cross")} <strong>${verdict}</strong>
      ${passes ? html`<span>${t.flies(flying, report.vehicles.length)}</span>` : nothing}
      ${passes
        ? nothing
        : button(actions, { id: "start-look", label: t.look, kind: "quiet", press: () => actions.openPanel("preflight") })}
    </p>
    ${staying.length
      ? html`<div class="dim" data-testid="start-staying">
          <p>${t.stays}:</p>
          <ul class="plain">
            ${staying.map(({ reason, vehicles }) => html`<li><b>${named(vehicles)}</b>: ${reason}</li>`)}
          </ul>
        </div>`
      : nothing}`;
}

export function start(state: State, actions: PanelActions): TemplateResult {
  const { drafts, startAt, startNamed } = state.panels;
  const selected = state.status?.show.selected;
  const command = startOrder(state);
  const begins = beginOrder(state);
  const wrong = typeof command === "string" ? command : "";
  const at_s = typeof command === "string" ? null : command.at_unix_time_s;
  const now_s = state.frame?.unix_time_s ?? 0;
  const isTomorrow = at_s !== null && new Date(at_s * 1000).getDate() !== new Date(now_s * 1000).getDate() && at_s - now_s < DAY_S;
  return html`<form
    @submit=${(event: Event) => {
      event.preventDefault();
      actions.start();
    }}
  >
    <div class="rowed"><b>${t.show}</b><span data-testid="start-show">${selected ? selected.name : t.noShow}</span></div>
    <div class="rowed">
      <b>${t.when}</b>
      ${choices("start-when", t.when, [{ value: "now", label: t.now }, { value: "at", label: t.at }], startAt ? "at" : "now", (value) =>
        actions.set({ startAt: value === "at" }),
      )}
    </div>
    ${startAt
      ? textField(state, actions, { field: "start-time", label: t.atLabel, placeholder: "21:30", focus: true, problem: drafts["start-time"] && wrong === t.badTime ? wrong : "" })
      : nothing}
    ${isTomorrow ? html`<p class="problem">${t.tomorrow}</p>` : nothing}
    ${beginRow(state, actions)}
    <div class="rowed">
      <b>${t.who}</b>
      ${choices("start-who", t.who, [{ value: "all", label: t.all }, { value: "named", label: t.named }], startNamed ? "named" : "all", (value) =>
        actions.set({ startNamed: value === "named" }),
      )}
    </div>
    ${startNamed
      ? textField(state, actions, { field: "start-names", label: t.namedLabel, placeholder: "d1 d2 d3", focus: true })
      : nothing}
    ${readiness(state, actions)}
    <div class="buttons">
      ${button(actions, {
        id: "start-go",
        label: t.goes(at_s === null ? "" : clockTime(at_s), typeof begins === "number" ? clockTime(begins) : ""),
        kind: "primary",
        icon: "takeoff",
        focus: true,
        why: whyNotStart(state),
        press: () => actions.start(),
      })}
      ${button(actions, { id: "start-cancel", label: texts.shell.cancel, press: () => actions.sheet(null) })}
    </div>
  </form>`;
}
