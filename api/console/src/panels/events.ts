/** Events: the service's log, the commands with the outcome of each vehicle, and refusals. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { Command, State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { choices } from "./controls";
import { clockTime, tail } from "./format";
import { icon, type IconName } from "./icons";

const t = texts.events;
const LETTERS = 12;

const OUTCOME_ICON: Record<Command["outcome"], IconName> = {
  pending: "events",
  done: "check",
  failed: "cross",
  "not-included": "offline",
};

export function outcome(value: Command["outcome"]): TemplateResult {
  return html`<span class="outcome outcome-${value}">${icon(OUTCOME_ICON[value])}${t.outcomes[value]}</span>`;
}

/** "3 done, 1 failed" */
function sum(command: Command): string {
  const counts = new Map<string, number>();
  for (const part of Object.values(command.outcomes)) counts.set(part.outcome, (counts.get(part.outcome) ?? 0) + 1);
  return [...counts].map(([what, count]) => t.count(count, t.outcomes[what] ?? what)).join(", ");
}

function command(state: State, actions: PanelActions, one: Command): TemplateResult {
  const open = state.panels.openCommand === one.id;
  const parts = Object.entries(one.outcomes);
  const telling = open ? parts : parts.filter(([, part]) => part.outcome === "failed");
  return html`<li class="event" data-testid="order-${one.id}">
    <button
      type="button"
      class="event-line"
      aria-expanded=${String(open)}
      @click=${() => actions.set({ openCommand: open ? null : one.id })}
    >
      <time>${clockTime(one.accepted_unix_time_s)}</time>
      <strong>${t.action(one.action)}</strong>
      <span class="dim">${t.by(one.by)}, ${sum(one)}</span>
      <span class="spring"></span>
      ${outcome(one.outcome)}
    </button>
    ${telling.length
      ? html`<ul class="plain parts">
          ${telling.map(([id, part]) => html`<li>${outcome(part.outcome)} <b>${id}</b> ${part.reason}</li>`)}
        </ul>`
      : nothing}
  </li>`;
}

function severityIcon(severity: string): IconName {
  if (severity === "error" || severity === "critical") return "cross";
  return severity === "warning" ? "warning" : "info";
}

function lines(state: State, actions: PanelActions): TemplateResult {
  const all = [...(state.status?.events ?? [])].sort((a, b) => b.number - a.number);
  if (all.length === 0) return html`<p class="empty">${t.none}</p>`;
  return html`<ul class="events" data-testid="event-lines">
    ${all.map(
      (each) => html`<li class="event line severity-${each.severity}">
        <time>${clockTime(each.unix_time_s)}</time>
        ${icon(severityIcon(each.severity))}
        ${each.vehicle
          ? html`<button type="button" class="link" title=${each.vehicle} @click=${() => actions.select(each.vehicle!)}>${tail(each.vehicle, LETTERS)}</button>`
          : nothing}
        <span>${each.text}</span>
      </li>`,
    )}
  </ul>`;
}

function refusals(state: State): TemplateResult {
  const all = state.panels.refusals;
  if (all.length === 0) return html`<p class="empty">${t.none}</p>`;
  return html`<ul class="events" data-testid="event-refusals">
    ${all.map(
      (each) => html`<li class="event line severity-warning">
        <time>${clockTime(each.unix_time_s)}</time>${icon("cross")}<span>${each.text}</span>
      </li>`,
    )}
  </ul>`;
}

export function events(state: State, actions: PanelActions): TemplateResult {
  const { eventList } = state.panels;
  return html`<div class="events-panel" data-testid="events">
    ${choices(
      "events",
      t.title,
      [
        { value: "lines", label: t.lines },
        { value: "commands", label: t.commands },
        { value: "refused", label: `${t.refused}${state.panels.refusals.length ? ` ${state.panels.refusals.length}` : ""}` },
      ],
      eventList,
      (value) => actions.set({ eventList: value }),
    )}
    ${eventList === "lines"
      ? lines(state, actions)
      : eventList === "refused"
        ? refusals(state)
        : state.commands.length
          ? html`<ul class="events" data-testid="event-commands">
              ${state.commands.map((one) => command(state, actions, one))}
            </ul>`
          : html`<p class="empty">${t.noOrders}</p>`}
  </div>`;
}
