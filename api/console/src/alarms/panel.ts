// The list of alarms, beside the scene: the most severe first, and none of importance folded away.

import { html, nothing, type TemplateResult } from "lit-html";
import { keyed } from "lit-html/directives/keyed.js";
import { repeat } from "lit-html/directives/repeat.js";

import type { PanelActions } from "../panels/actions";
import { button } from "../panels/controls";
import { clockTime, seconds } from "../panels/format";
import { icon, type IconName } from "../panels/icons";
import { isBesideAPanel, isSmall } from "../panels/layout";
import { FROM, whyNot, whyNotAcknowledge, whyNotOnGround, whyNotShow } from "../panels/rights";
import { fresh, indexOf, PHASES, type State } from "../state";
import { texts } from "../texts";
import { ALWAYS_SHOWN, alarmsOf, counted, isOpen, lasts, mayAcknowledge, commanded, showCommand, worst, type Alarm, type Overall } from "./model";

const t = texts.alarms;

export const SEVERITY_ICON: Record<Overall, IconName> = {
  emergency: "emergency",
  warning: "warning",
  caution: "caution",
  information: "info",
  normal: "check",
};

const VEHICLES_NAMED = 24; // links in one alarm; the rest are selected by "all"
const LINKS_IN_A_DENSE_ROW = 3; // of more vehicles it has "all" alone: their names take the room of another alarm

function vehicles(actions: PanelActions, alarm: Alarm): TemplateResult | typeof nothing {
  if (alarm.vehicles.length === 0) return nothing;
  const named = alarm.vehicles.slice(0, VEHICLES_NAMED);
  const more = alarm.vehicles.length - named.length;
  return html`<span class="alarm-vehicles ${named.length > LINKS_IN_A_DENSE_ROW ? "many" : ""}">
    ${named.map((id) => html`<button type="button" class="link" data-testid="alarm-vehicle-${id}" @click=${() => actions.select(id)}>${id}</button> `)}
    ${more > 0 ? texts.preflight.moreVehicles(more) : nothing}
    ${alarm.vehicles.length > 1
      ? html`<button type="button" class="link all" data-testid="alarm-all-${alarm.id}" @click=${() => actions.choose({ how: "only", ids: alarm.vehicles })}>
          ${texts.selection.selectAll(alarm.vehicles.length)}
        </button>`
      : nothing}
  </span>`;
}

/** Each vehicle with its own reason, as a table. */
function reasons(actions: PanelActions, alarm: Alarm): TemplateResult | typeof nothing {
  if (alarm.reasons.length === 0) return nothing;
  return html`<table class="alarm-reasons" data-testid="alarm-reasons">
    <tbody>
      ${alarm.reasons.map(
        ({ vehicle, because }) =>
          html`<tr>
            <th scope="row"><button type="button" class="link" @click=${() => actions.select(vehicle)}>${vehicle}</button></th>
            <td>${because}</td>
          </tr>`,
      )}
    </tbody>
  </table>`;
}

/** Why the command that an alarm advises is not possible now; "" where it is. Pure. */
export function whyNotFollow(state: State, alarm: Alarm): string {
  const ofShow = showCommand(alarm);
  if (ofShow !== null) return whyNotShow(state, ofShow);
  const { action, vehicles } = alarm;
  switch (action) {
    case "leave-out":
    case "include":
      return whyNot(state, action) || whyNotOnGround(state);
    case "return":
    case "land":
    case "take-control":
    case "confirm-down": {
      const phases = vehicles.map((id) => PHASES[state.frame?.phase[indexOf(state, id)] ?? 0] ?? "offline");
      const why = whyNot(state, action);
      return why || (phases.some((phase) => FROM[action].includes(phase)) ? "" : texts.vehicle.notIn([...new Set(phases)].join(", ")));
    }
    default:
      return t.noAction;
  }
}

/** The button that does what the text advises; none where it would do nothing. */
function follows(state: State, actions: PanelActions, alarm: Alarm): TemplateResult | typeof nothing {
  const { action } = alarm;
  if (action === null || !lasts(alarm) || whyNotFollow(state, alarm) !== "") return nothing;
  const ofAll = showCommand(alarm) !== null;
  const isAsked = action === "confirm-down" && state.panels.sure === alarm.id;
  return button(actions, {
    id: `follow-${alarm.id}`,
    label: isAsked ? t.seenDown(alarm.vehicles.length) : t.actions[action],
    name: isAsked ? t.seenDown(alarm.vehicles.length) : t.actionTo(t.actions[action], ofAll ? [] : alarm.vehicles),
    press: () => actions.follow(alarm),
  });
}

/** Since when; a dense row has only for how long. */
function since(state: State, alarm: Alarm): TemplateResult {
  const now_s = state.frame?.unix_time_s ?? NaN;
  const lasted_s = (alarm.ended_unix_time_s ?? now_s) - alarm.since_unix_time_s;
  const time = clockTime(alarm.since_unix_time_s);
  const [when, much] = !lasts(alarm)
    ? [t.ended(time, clockTime(alarm.ended_unix_time_s)), t.isOver]
    : [time, fresh(state) && lasted_s >= 0 ? t.since(lasted_s < 100 ? `${Math.floor(lasted_s)} s` : seconds(lasted_s)) : ""];
  return html`<time class=${much === "" ? nothing : "alarm-from"}>${when}</time> <span>${much}</span>`;
}

function one(state: State, actions: PanelActions, alarm: Alarm): TemplateResult {
  const isNew = isOpen(alarm);
  return html`<li
    class="alarm alarm-${alarm.severity} ${isNew ? "open" : "seen"} ${lasts(alarm) ? "" : "ended"}"
    tabindex="-1"
    data-testid="alarm"
    data-alarm=${alarm.id}
    data-severity=${alarm.severity}
    data-cause=${alarm.cause}
  >
    ${icon(SEVERITY_ICON[alarm.severity])}
    <div class="alarm-words" title="${alarm.text} ${alarm.advice}">
      <div class="alarm-what">
        <p class="alarm-head"><b>${t.severities[alarm.severity]}</b> ${since(state, alarm)} ${vehicles(actions, alarm)}</p>
        <p class="alarm-text">${alarm.text}</p>
      </div>
      ${reasons(actions, alarm)} ${alarm.advice ? html`<p class="alarm-advice">${alarm.advice}</p>` : nothing}
      ${isNew
        ? nothing
        : html`<p class="alarm-seen">${icon("check")} ${t.acknowledged(alarm.acknowledged_by!, clockTime(alarm.acknowledged_unix_time_s))}</p>`}
    </div>
    ${follows(state, actions, alarm)}
    ${mayAcknowledge(alarm)
      ? button(actions, {
          id: `acknowledge-${alarm.id}`,
          label: t.acknowledge,
          name: t.acknowledgeOne(alarm.text),
          icon: "check",
          iconOnly: true,
          why: whyNotAcknowledge(state),
          press: () => actions.acknowledge(alarm.id),
        })
      : nothing}
  </li>`;
}

/** Text for a screen reader about new alarms, once; the list itself is silent. Always in the page, so that it is announced. */
export function announcer({ attention: { announced } }: State): TemplateResult {
  return html`<div class="for-readers" data-testid="announcer">
    <div role="alert">${keyed(announced.number, html`<p>${announced.urgent}</p>`)}</div>
    <div role="status">${keyed(announced.number, html`<p>${announced.calm}</p>`)}</div>
  </div>`;
}

export function alarms(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const all = commanded(alarmsOf(state.status));
  if (all.length === 0) return nothing;
  const { isFolded } = state.attention;
  const live = all.filter(lasts);
  const over = all.length - live.length;
  const minor = all.filter((each) => !ALWAYS_SHOWN.has(each.severity));
  const shown = isFolded ? all.filter((each) => ALWAYS_SHOWN.has(each.severity)) : all;
  const { layout, allAlarms } = state.panels;
  const isUnseen = isSmall(layout) && !allAlarms && all.length > 1; // what is not on screen is not acknowledged
  return html`<section class="alarm-list" tabindex="-1" aria-label=${t.title} data-testid="alarms">
    <header>
      <h2>${t.title} <b data-testid="alarm-count">${live.length}</b></h2>
      <span class="alarm-counts">
        ${counted(live).map(({ severity, count }) => html`<span class="alarm-count-${severity}" title=${t.counts[severity](count)}>${icon(SEVERITY_ICON[severity])}${count}</span>`)}
        ${over > 0 ? html`<span class="dim">${t.over(over)}</span>` : nothing}
      </span>
      <span class="spring"></span>
      ${all.length > 1 && (allAlarms || isBesideAPanel(state.panels))
        ? button(actions, {
            id: "alarms-all",
            label: allAlarms ? t.seeFewer : t.seeAll(all.length),
            icon: allAlarms ? "up" : "down",
            kind: "quiet",
            expanded: allAlarms,
            press: () => actions.set({ allAlarms: !allAlarms }),
          })
        : nothing}
      ${all.some(mayAcknowledge) && !isUnseen
        ? button(actions, {
            id: "acknowledge-all",
            label: t.acknowledgeAll,
            kind: "quiet",
            why: whyNotAcknowledge(state),
            press: () => actions.acknowledgeAll(),
          })
        : nothing}
    </header>
    <ul aria-label=${t.listLabel(all.length)} data-testid="alarm-list">
      ${repeat(shown, (each) => each.id, (each) => one(state, actions, each))}
    </ul>
    ${minor.length > 0
      ? button(actions, {
          id: "alarms-fold",
          label: isFolded ? t.unfold(counted(minor).map(({ severity, count }) => t.counts[severity](count)).join(", ")) : t.fold,
          icon: isFolded ? "down" : "up",
          kind: "quiet",
          expanded: !isFolded,
          press: () => actions.dispatch({ kind: "fold-alarms", isFolded: !isFolded }),
        })
      : nothing}
  </section>`;
}

/** In the top bar: the worst of all alarms in colour and in a word; a press goes to the list. */
export function overall(state: State): TemplateResult {
  const all = alarmsOf(state.status);
  const worstOf = worst(all);
  const severity = worstOf === "normal" && !fresh(state) && !state.status?.replay ? "unknown" : worstOf; // old data is no green light
  const live = all.filter(lasts).length;
  return html`<button
    type="button"
    class="overall overall-${severity} ${all.some(isOpen) ? "open" : ""}"
    data-testid="overall"
    data-severity=${severity}
    title=${t.goTo}
    @click=${() => document.querySelector<HTMLElement>('[data-testid="alarms"]')?.focus()}
  >
    ${icon(severity === "unknown" ? "question" : SEVERITY_ICON[severity])}
    <span class="overall-words">
      <strong data-testid="overall-word">${t.overall[severity]}</strong>
      <small>${severity === "unknown" ? t.notFresh : t.count(live, all.length - live)}</small>
    </span>
  </button>`;
}

const UNLOCKING_MS = 1000;

/** The press that made the browser play sound is none that switches it off. */
function isUnlocking({ attention: { soundBlocked, unblocked_ms }, page_ms }: State): boolean {
  return soundBlocked || page_ms - unblocked_ms < UNLOCKING_MS;
}

/** The sound of alarms: on, off, or waiting for a press, since a browser plays nothing before one. */
export function soundButton(state: State, actions: PanelActions): TemplateResult {
  const { soundOn, soundBlocked } = state.attention;
  return button(actions, {
    id: "sound",
    label: !soundOn ? t.soundOff : soundBlocked ? t.soundBlocked : t.soundOn,
    icon: soundOn && !soundBlocked ? "sound" : "mute",
    iconOnly: true,
    kind: "quiet",
    pressed: soundOn,
    press: () => actions.sound(!soundOn || isUnlocking(actions.now())),
  });
}
