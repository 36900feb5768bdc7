/** The clock time at which the selected show begins to move: ordered, counted down, cancelled. */

import { html, nothing, type TemplateResult } from "lit-html";
import { begunBy } from "../features";
import type { ShowPhase, State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button, choices, textField, twice } from "./controls";
import { clockTime, minutes, nextClockTime, utcTime } from "./format";
import { icon } from "./icons";
import { airborne, whyNot } from "./rights";

const t = texts.begin;
const DAY_S = 86_400;

/** A clock time further ahead has passed, or was mistyped. */
const AHEAD_MAX_S = DAY_S / 2;

/** In these a show that has not begun waits; on the ground before the start nothing waits yet. */
const WAITS: readonly ShowPhase[] = ["countdown", "preflight", "arming", "assembling", "paused"];

/** A typed clock time in s since 1970, or why a show cannot begin then. Pure. */
export function beginTime(text: string, now_s: number): number | string {
  const at_s = nextClockTime(text, now_s);
  if (at_s === null) return t.badTime;
  const ahead_s = at_s - now_s;
  return ahead_s <= AHEAD_MAX_S ? at_s : t.past(clockTime(at_s), minutes(DAY_S - ahead_s), minutes(ahead_s));
}

const typed = (state: State): number | string => beginTime(state.panels.drafts["begin-time"] ?? "", state.frame?.unix_time_s ?? NaN);

/** What a start orders before it takes off: a time, null for none, or why that cannot be sent. Pure. */
export function beginOrder(state: State): number | string | null {
  return state.panels.beginAt && whyNotOffered(state) === "" && begins(state) === null ? typed(state) : null;
}

const begins = (state: State) => state.status?.show.selected?.begin ?? null;

/** Why no time can be given to this show at all; "" where one can. */
function whyNotOffered({ status }: State): string {
  const selected = status?.show.selected;
  if (!selected) return t.noShow;
  if (selected.begun) return t.begun;
  return begunBy(status);
}

/** Why the typed time cannot be ordered now; "" where it can. Pure. */
export function whyNotBegin(state: State): string {
  const at_s = typed(state);
  return whyNot(state, "begin") || whyNotOffered(state) || (typeof at_s === "string" ? at_s : "");
}

/** Local time is typed and shown; UTC stands beside it, since that is what is sent. */
function field(state: State, actions: PanelActions): TemplateResult {
  const at_s = typed(state);
  const isTyped = (state.panels.drafts["begin-time"] ?? "") !== "";
  const now_s = state.frame?.unix_time_s;
  return html`${textField(state, actions, {
    field: "begin-time", label: t.label, placeholder: "21:30:00", focus: true, problem: isTyped && typeof at_s === "string" ? at_s : "",
  })}
  ${typeof at_s === "number" && now_s !== undefined
    ? html`<p class="dim" data-testid="begin-means">${t.means(utcTime(at_s), minutes(at_s - now_s))}</p>`
    : nothing}`;
}

/** A row of the start: when the show begins once it has taken off. */
export function beginRow(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const why = whyNotOffered(state);
  const set = begins(state);
  if (!state.status?.show.selected) return nothing;
  if (why !== "" || set !== null) {
    const text = set === null ? why : set.at_unix_time_s === null ? t.states.held : clockTime(set.at_unix_time_s);
    return html`<div class="rowed"><b>${t.row}</b><span data-testid="start-begins">${text}</span></div>`;
  }
  return html`<div class="rowed">
      <b>${t.row}</b>
      ${choices("begin-when", t.row, [{ value: "ready", label: t.whenReady }, { value: "at", label: texts.start.at }], state.panels.beginAt ? "at" : "ready", (value) =>
        actions.set({ beginAt: value === "at" }),
      )}
    </div>
    ${state.panels.beginAt ? field(state, actions) : nothing}`;
}

/** A dialog of its own: a time is given or changed, also in the air. */
export function begin(state: State, actions: PanelActions): TemplateResult {
  const at_s = typed(state);
  return html`<form
    @submit=${(event: Event) => {
      event.preventDefault();
      actions.begin();
    }}
  >
    <div class="rowed"><b>${texts.start.show}</b><span>${state.status?.show.selected?.name ?? texts.start.noShow}</span></div>
    ${field(state, actions)}
    <div class="buttons">
      ${button(actions, {
        id: "begin-go",
        label: typeof at_s === "number" ? t.goAt(clockTime(at_s)) : t.go,
        kind: "primary",
        why: whyNotBegin(state),
        press: () => actions.begin(),
      })}
      ${button(actions, { id: "begin-close", label: texts.shell.cancel, press: () => actions.sheet(null) })}
    </div>
  </form>`;
}

/** Across the page while a show has not begun: when it does, how long until then, and what can be done about it. */
export function beginStrip(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const show = state.status?.show;
  const set = begins(state);
  if (!show?.selected || state.status?.replay || whyNotOffered(state) !== "") return nothing;
  if (set === null && !WAITS.includes(show.phase)) return nothing;
  const now_s = state.frame?.unix_time_s ?? NaN;
  const at_s = set?.at_unix_time_s ?? null;
  const left_s = at_s === null ? NaN : at_s - now_s;
  const why = whyNot(state, "begin");
  return html`<section class="strip begin-strip ${set?.state ?? ""}" aria-label=${t.title} data-testid="begins">
    <div class="strip-words">
      <span class="strip-group">
        ${icon("events")}
        <strong>${at_s === null ? t.noTime(show.selected.name) : t.at(show.selected.name, clockTime(at_s))}</strong>
        ${at_s === null ? nothing : html`<span class="dim spare">${t.utc(utcTime(at_s))}</span>`}
      </span>
      ${left_s > 0 ? html`<span class="value big-figure" data-testid="begins-in">${t.left(minutes(Math.ceil(left_s)))}</span>` : nothing}
      <span class=${left_s > 0 ? "spare" : ""} data-testid="begins-state">${set === null ? t.whenAll : left_s <= 0 ? t.late(minutes(-left_s)) : t.states[set.state]}</span>
    </div>
    <div class="buttons">
      ${button(actions, { id: "begin", label: set === null || at_s === null ? t.give : t.change, why, press: () => actions.sheet("begin") })}
      ${at_s === null
        ? nothing
        : twice(state, actions, {
            id: "begin-cancel",
            label: t.cancel,
            sure: airborne(state) > 0 ? t.sureInTheAir : t.sureOnGround,
            about: `begin:${at_s}`,
            why,
            press: () => actions.cancelBegin(),
          })}
    </div>
  </section>`;
}
