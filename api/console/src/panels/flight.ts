/** The big buttons. Those that bring the fleet down need one press, the kill two steps; see kill.ts. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { ShowAction, State } from "../state";
import { texts } from "../texts";
import { fresh } from "../state";
import type { PanelActions } from "./actions";
import { icon, type IconName } from "./icons";
import { KEYS } from "../keys";
import { failures, preflightNow } from "./preflight";
import { whyNoStart, whyNot, whyNotShow } from "./rights";

type Big = ShowAction | "kill";

const BIG: readonly { action: Big; icon: IconName }[] = [
  { action: "start", icon: "start" },
  { action: "pause", icon: "pause" },
  { action: "resume", icon: "resume" },
  { action: "stop", icon: "home" },
  { action: "abort", icon: "land" },
  { action: "kill", icon: "kill" },
];

export function whyNotBig(state: State, action: Big): string {
  return action === "kill" ? whyNot(state, "kill") : whyNotShow(state, action);
}

/** What is known to speak against it already; the service has the last word. */
function warning(state: State, action: Big): string {
  if (action !== "start") return "";
  const report = preflightNow(state);
  return report && !report.passes ? texts.flight.fails(failures(report)) : whyNoStart(state);
}

/** What a big button does, by pointer or key. */
export function pressBig(state: State, actions: PanelActions, action: Big): void {
  const why = whyNotBig(state, action);
  if (why !== "") actions.refuse(texts.flight[action], why);
  else if (action === "start" || action === "kill") actions.sheet(action);
  else actions.show(action);
}

export function flight(state: State, actions: PanelActions): TemplateResult {
  const { sheet } = state.panels;
  return html`<section class="flight" aria-label=${texts.flight.title}>
    ${BIG.map(({ action, icon: name }) => {
      const why = whyNotBig(state, action);
      const opens = action === "start" || action === "kill";
      const what = why || (fresh(state) ? (warning(state, action) || texts.flight.what[action]) : texts.flight.decides);
      return html`<button
        type="button"
        class="big big-${action} ${why === "" && warning(state, action) ? "warned" : ""}"
        data-testid=${action}
        aria-disabled=${why === "" ? nothing : "true"}
        aria-expanded=${opens ? String(sheet === action) : nothing}
        aria-keyshortcuts="Shift+${KEYS[action]}"
        aria-describedby="why-${action}"
        title=${why || nothing}
        @click=${() => pressBig(state, actions, action)}
      >
        ${icon(name)}
        <span class="big-label">${texts.flight[action]}</span>
        <kbd aria-hidden="true">⇧${KEYS[action]}</kbd>
        <small id="why-${action}" data-testid="why-${action}">${what}</small>
      </button>`;
    })}
  </section>`;
}
