/** Kill, in two deliberate steps: choose and arm; then hold a button for two seconds, or type the code. */

import { html, type TemplateResult } from "lit-html";
import { PHASES, type Kill, type State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button, choices, textField } from "./controls";
import { seconds } from "./format";
import { icon, PHASE_ICON } from "./icons";
import { place } from "./place";
import { whyNot } from "./rights";
import { HOLD_MS } from "./state";

const t = texts.kill;

/** Vehicles that the first step would name: those chosen, or every one that is not offline. Pure. */
export function doomed(state: State): string[] {
  const { status, frame, panels } = state;
  if (!status || !frame) return [];
  return status.vehicles
    .filter((each, i) => (panels.killNamed ? panels.killNamed.has(each.id) : PHASES[frame.phase[i] ?? 0] !== "offline"))
    .map((each) => each.id);
}

function choose(state: State, actions: PanelActions): TemplateResult {
  const { killNamed } = state.panels;
  const chosen = doomed(state);
  return html`<h3>${t.who}</h3>
    ${choices(
      "kill-who",
      t.who,
      [{ value: "named", label: t.named }, { value: "all", label: t.all }],
      killNamed ? "named" : "all",
      (value) => actions.set({ killNamed: value === "named" ? (killNamed ?? new Set(actions.now().view.selection)) : null }),
    )}
    ${killNamed
      ? html`<p class="dim" role="status" data-testid="kill-count">${t.listed(chosen.length, state.status?.vehicles.length ?? 0)}</p>
          <div class="picks">
          ${(state.status?.vehicles ?? []).map((each, i) => {
            const phase = PHASES[state.frame?.phase[i] ?? 0] ?? "offline";
            return html`<button
              type="button"
              class="chip"
              data-testid="kill-pick-${each.id}"
              aria-pressed=${String(killNamed.has(each.id))}
              @click=${() => actions.set({ killNamed: toggle(actions.now().panels.killNamed ?? new Set(), each.id) })}
            >
              ${icon(PHASE_ICON[phase])}${each.id}
            </button>`;
          })}
        </div>`
      : ""}
    <p class="names value" data-testid="kill-names">${chosen.join(", ") || t.none}</p>
    <div class="buttons">
      ${button(actions, {
        id: "kill-arm",
        label: t.arm,
        kind: "danger",
        icon: "kill",
        why: whyNot(state, "kill") || (chosen.length ? "" : t.none),
        press: () => actions.armKill(actions.now().panels.killNamed ? doomed(actions.now()) : null),
      })}
      ${button(actions, { id: "kill-cancel", label: texts.shell.cancel, focus: true, press: () => actions.sheet(null) })}
      <small>${t.armWhat}</small>
    </div>`;
}

function toggle(chosen: ReadonlySet<string>, id: string): ReadonlySet<string> {
  const next = new Set(chosen);
  if (!next.delete(id)) next.add(id);
  return next;
}

const HOLD_KEYS: readonly string[] = [" ", "Enter"];

function holdButton(state: State, actions: PanelActions): TemplateResult {
  const { holding_ms } = state.panels;
  const share = holding_ms === null ? 0 : Math.min(1, (state.page_ms - holding_ms) / HOLD_MS);
  const down = (event: KeyboardEvent): void => {
    if (!HOLD_KEYS.includes(event.key)) return;
    event.preventDefault();
    if (!event.repeat) actions.holdKill();
  };
  const up = (event: KeyboardEvent): void => {
    if (HOLD_KEYS.includes(event.key)) actions.releaseKill();
  };
  return html`<button
    type="button"
    class="hold ${holding_ms === null ? "" : "holding"}"
    data-testid="kill-hold"
    @pointerdown=${() => actions.holdKill()}
    @pointerup=${() => actions.releaseKill()}
    @pointerleave=${() => actions.releaseKill()}
    @pointercancel=${() => actions.releaseKill()}
    @blur=${() => actions.releaseKill()}
    @keydown=${down}
    @keyup=${up}
  >
    <span class="hold-fill" ${place({ transform: `scaleX(${share.toFixed(3)})` })}></span>
    <span class="hold-label">${icon("kill")} ${holding_ms === null ? t.hold : t.holding}</span>
  </button>`;
}

function confirm(state: State, actions: PanelActions, kill: Kill): TemplateResult {
  const { armed, until_ms } = kill;
  const left_s = Math.max(0, (until_ms - state.page_ms) / 1000);
  return html`<h3>${t.armed(armed.vehicles.length)}</h3>
    <p class="names value" data-testid="kill-names">${armed.vehicles.join(", ")}</p>
    <div class="left"><span ${place({ transform: `scaleX(${(left_s / armed.valid_s).toFixed(3)})` })}></span></div>
    <p class="time-left" role="timer" data-testid="kill-left">${t.left(seconds(left_s))}</p>
    ${holdButton(state, actions)}
    <p class="dim">${t.holdWhat} <b class="code" data-testid="kill-code">${armed.code}</b></p>
    <form
      class="inline-form rowed"
      @submit=${(event: Event) => {
        event.preventDefault();
        actions.confirmTyped();
      }}
    >
      ${textField(state, actions, { field: "kill-typed", label: t.code })}
      <button type="submit" class="button danger" data-testid="kill-type"><span>${t.type}</span></button>
      ${button(actions, { id: "kill-disarm", label: t.disarm, focus: true, press: () => actions.disarmKill() })}
    </form>`;
}

export function kill(state: State, actions: PanelActions): TemplateResult {
  return state.kill ? confirm(state, actions, state.kill) : choose(state, actions);
}
