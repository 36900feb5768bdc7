/** Where the service requires a token: the page requests one. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button, textField } from "./controls";
import { icon } from "./icons";

const t = texts.token;

export function login(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  if (state.connection.kind !== "denied") return nothing;
  const typed = (state.panels.drafts["token"] ?? "").trim();
  return html`<section class="sheet login" role="dialog" aria-modal="true" aria-label=${t.title} data-testid="login">
    <h2>${icon("limited")} ${t.title}</h2>
    <p class="problem" role="alert" data-testid="login-reason">${state.connection.reason}</p>
    <p class="dim">${t.what}</p>
    <form
      @submit=${(event: Event) => {
        event.preventDefault();
        actions.enter();
      }}
    >
      ${textField(state, actions, { field: "token", label: t.label, focus: true, secret: true })}
      <div class="buttons">
        ${button(actions, { id: "token-enter", label: t.send, kind: "primary", why: typed === "" ? t.label : "", press: () => actions.enter() })}
      </div>
    </form>
  </section>`;
}
