// The way back after a stall or a restart of the service: vehicles fly, and no command of this station reaches them yet.

import { html, nothing, type TemplateResult } from "lit-html";

import type { PanelActions } from "../panels/actions";
import { button } from "../panels/controls";
import { clockTime } from "../panels/format";
import { icon } from "../panels/icons";
import { whyNot } from "../panels/rights";
import { byReason } from "../panels/start";
import type { State } from "../state";
import { texts } from "../texts";

const t = texts.recovery;

type Offer = "take-over" | "bring-home";

/** The commands that lead back. They stand with the flight commands, where they are on screen at any size. */
export function offers(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const cut = state.status?.interrupted;
  if (!cut) return nothing;
  const offer = (name: Offer, label: string, what: string): TemplateResult =>
    html`<div class="offer">
      ${button(actions, {
        id: name,
        label,
        describedBy: `what-${name}`,
        kind: "primary",
        icon: name === "bring-home" ? "home" : "resume",
        why: whyNot(state, name) || (cut.offers.includes(name) ? "" : t.not(label)),
        press: () => actions.show(name),
      })}<small id="what-${name}">${what}</small>
    </div>`;
  return html`<section class="offers" aria-label=${t.title}>
    ${offer("take-over", t.takeOver, t.takeOverWhat)} ${offer("bring-home", t.bringHome, t.bringHomeWhat)}
  </section>`;
}

/** What happened, and what each vehicle does now. */
export function recovery(state: State): TemplateResult | typeof nothing {
  const cut = state.status?.interrupted;
  if (!cut) return nothing;
  const flying = state.status?.counts.uncontrolled ?? 0;
  const vehicles = byReason(Object.fromEntries(Object.entries(cut.vehicles).map(([id, one]) => [id, one.text])));
  return html`<section class="interrupted" role="alert" aria-label=${t.title} data-testid="interrupted">
    <h2>${icon("warning")} ${flying > 0 ? t.flying(flying) : t.title}</h2>
    <p>${t.when(cut.cause, clockTime(cut.unix_time_s), texts.phases[cut.show])}</p>
    <ul class="plain">
      ${vehicles.map(({ reason, vehicles: ids }) => html`<li><strong>${ids.join(", ")}</strong>: ${reason}</li>`)}
      ${cut.problems.map((text) => html`<li class="problem">${text}</li>`)}
    </ul>
  </section>`;
}
