// The desk: everything around the scene. (Nothing but the connection is shown yet.)

import { html, type TemplateResult } from "lit-html";

import type { Actions } from "../actions";
import type { State } from "../state";

export function desk(state: State, _actions: Actions): TemplateResult {
  return html`<p role="status">${state.connection.kind} ${state.connection.reason}</p>`;
}
