/** Old data, and answers to commands: shown where they cannot be overlooked. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { State, Toast } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button } from "./controls";
import { seconds } from "./format";
import { icon, type IconName } from "./icons";
import { missing } from "./stations";
import { life } from "./topbar";

/** Across the page, while what is shown is not how it is now. */
export function banner(state: State): TemplateResult | typeof nothing {
  const now = life(state);
  if (now === "live" && missing(state.status).length > 0) return stationsMissing(state);
  if (now === "live" || now === "replay" || now === "denied") return nothing;
  const age = state.frame ? seconds((state.page_ms - state.frame.received_ms) / 1000) : "";
  const text =
    now === "connecting"
      ? texts.connection.connecting
      : now === "dead"
        ? texts.connection.dead(state.status?.control_reason ?? "")
        : now === "stale"
          ? texts.connection.stale(age)
          : age
            ? texts.connection.lost(age)
            : texts.connection.lostNever;
  const hints = [
    ...(now === "lost" ? [`${state.connection.reason}.`, texts.connection.again] : []),
    ...(now === "connecting" ? [] : [now === "dead" ? texts.connection.deadWhat : texts.connection.commands]),
  ];
  return html`<div class="banner banner-${now}" role="alert" data-testid="banner">
    ${icon(now === "connecting" ? "events" : "warning")}
    <strong>${text}</strong>
    <span>${hints.join(" ")}</span>
  </div>`;
}

/** Stations that are not received: no command reaches their vehicles, and what is shown of them is old. */
function stationsMissing(state: State): TemplateResult {
  const gone = missing(state.status);
  return html`<div class="banner banner-stations" role="alert" data-testid="banner-stations">
    ${icon("warning")}
    <strong>${texts.stations.notReceived(gone.map((each) => each.name).join(", "))}</strong>
    <span>${texts.stations.shownAsLast(gone.reduce((sum, each) => sum + each.vehicles, 0))}${gone.some((each) => each.leads) ? ` ${texts.stations.leadIsGone}` : ""}</span>
  </div>`;
}

const TOAST_ICON: Record<Toast["kind"], IconName> = { done: "check", grave: "kill", refused: "cross" };

/** Answers to commands; refusals stay longer, and stay in the events. */
export function toasts(state: State, actions: PanelActions): TemplateResult {
  return html`<section class="toasts" aria-label=${texts.toasts.title} aria-live="assertive" data-testid="toasts">
    ${state.toasts.map(
      (each) => html`<div class="toast ${each.kind}" data-testid="toast-${each.kind}">
        ${icon(TOAST_ICON[each.kind])}
        <span>${each.text}</span>
        ${button(actions, {
          id: "toast-dismiss",
          label: texts.toasts.dismiss,
          icon: "cross",
          iconOnly: true,
          kind: "quiet",
          press: () => actions.dispatch({ kind: "toast-gone", id: each.id }),
        })}
      </div>`,
    )}
  </section>`;
}
