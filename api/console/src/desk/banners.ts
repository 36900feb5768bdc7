/** What nobody may overlook: old data, notices, what the service does by itself, a flight that was cut off. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { State } from "../state";
import { texts } from "../texts";
import type { DeskActions } from "./actions";
import { button } from "./controls";
import { clockTime, seconds } from "./format";
import { icon } from "./icons";
import { whyNot } from "./rights";
import { life } from "./topbar";

const NOTICES_SHOWN = 2;

/** Across the page, while what is shown is not how it is now. */
export function banner(state: State): TemplateResult | typeof nothing {
  const now = life(state);
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
    ...(now === "connecting" ? [] : [texts.connection.orders]),
  ];
  return html`<div class="banner banner-${now}" role="alert" data-testid="banner">
    ${icon(now === "connecting" ? "events" : "warning")}
    <strong>${text}</strong>
    <span>${hints.join(" ")}</span>
  </div>`;
}

function reactions(state: State): TemplateResult[] {
  return (state.status?.reactions ?? []).map(
    (each) => html`<li class="notice reaction" data-testid="reaction">
      ${icon("warning")}
      <span>
        <strong>${texts.notices.reacting(texts.notices.actions[each.action] ?? each.action)}</strong>
        ${each.cause}: ${each.reason}${each.vehicles.length ? ` (${each.vehicles.join(", ")})` : ""}
        <small>
          ${clockTime(each.since_unix_time_s)},
          ${each.order_id ? `${texts.notices.ordered}: ${each.order_id}` : texts.notices.notOrdered}
        </small>
      </span>
    </li>`,
  );
}

export function notices(state: State, actions: DeskActions): TemplateResult | typeof nothing {
  const all = [
    ...reactions(state),
    ...(state.status?.notices ?? []).map(
      (text) => html`<li class="notice" data-testid="notice">${icon("info")}<span>${text}</span></li>`,
    ),
  ];
  if (all.length === 0) return nothing;
  const open = state.desk.allNotices;
  const shown = open ? all : all.slice(0, NOTICES_SHOWN);
  return html`<section class="notices" aria-label=${texts.notices.title} data-testid="notices">
    <ul>
      ${shown}
    </ul>
    ${all.length > NOTICES_SHOWN
      ? button(actions, {
          id: "notices-more",
          label: open ? texts.notices.less : texts.notices.more(all.length - NOTICES_SHOWN),
          kind: "quiet",
          expanded: open,
          press: () => actions.set({ allNotices: !open }),
        })
      : nothing}
  </section>`;
}

export function interrupted(state: State, actions: DeskActions): TemplateResult | typeof nothing {
  const cut = state.status?.interrupted;
  if (!cut) return nothing;
  const offer = (name: "take-over" | "bring-home", label: string, what: string, id: string): TemplateResult =>
    html`<div class="offer">
      ${button(actions, {
        id,
        label,
        kind: "primary",
        icon: name === "bring-home" ? "home" : "resume",
        why: whyNot(state, name) || (cut.offers.includes(name) ? "" : texts.interrupted.not(label)),
        press: () => actions.show(name),
      })}<small>${what}</small>
    </div>`;
  return html`<section class="interrupted" role="alert" aria-label=${texts.interrupted.title} data-testid="interrupted">
    <h2>${icon("warning")} ${texts.interrupted.title}</h2>
    <p>${texts.interrupted.when(clockTime(cut.unix_time_s), texts.phases[cut.show])}</p>
    <ul class="plain">
      ${Object.entries(cut.vehicles).map(([id, one]) => html`<li><strong>${id}</strong> ${one.text}</li>`)}
      ${cut.problems.map((text) => html`<li class="problem">${text}</li>`)}
    </ul>
    <div class="offers">
      ${offer("take-over", texts.interrupted.takeOver, texts.interrupted.takeOverWhat, "take-over")}
      ${offer("bring-home", texts.interrupted.bringHome, texts.interrupted.bringHomeWhat, "bring-home")}
    </div>
  </section>`;
}

/** Answers to what was ordered; those that were refused stay longer, and in the events. */
export function toasts(state: State, actions: DeskActions): TemplateResult {
  return html`<section class="toasts" aria-label=${texts.toasts.title} aria-live="assertive" data-testid="toasts">
    ${state.toasts.map(
      (each) => html`<div class="toast ${each.kind}" data-testid="toast-${each.kind}">
        ${icon(each.kind === "done" ? "check" : "cross")}
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
