/** The top bar: the show's phase, whether the data are current, the user, and the appearance. */

import { html, nothing, type TemplateResult } from "lit-html";
import { overall, soundButton } from "../alarms/panel";
import { fresh, type State, type Status } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { camera } from "./camera";
import { button } from "./controls";
import { clockTime, minutes, withUnit } from "./format";
import { icon, type IconName } from "./icons";
import { isSmall } from "./layout";
import { halted } from "../features";

type Life = keyof typeof texts.bar.states;

/** How much of what is shown may be believed. */
export function life(state: State): Life {
  const { kind } = state.connection;
  if (kind !== "live") return kind;
  const replays = state.status?.replay != null;
  if (state.frame && !state.frame.controlAlive) return replays ? "stale" : "dead"; // a replay has no control
  if (!fresh(state)) return "stale";
  return replays ? "replay" : "live";
}

const LIFE_ICON: Record<Life, IconName> = {
  live: "check",
  replay: "resume",
  stale: "warning",
  connecting: "events",
  lost: "cross",
  denied: "cross",
  dead: "cross",
};

const SHOW_ICON: Record<keyof typeof texts.phases, IconName> = {
  idle: "standby",
  countdown: "events",
  preflight: "preflight",
  arming: "takeoff",
  assembling: "shape",
  running: "start",
  paused: "pause",
  returning: "home",
  aborting: "land",
  landed: "check",
  uncontrolled: "warning",
};

function gauge(name: string, value: string, id: string, more: string = ""): TemplateResult {
  return html`<div class="gauge" data-testid=${id}>
    <span class="gauge-name">${name}</span>
    <span class="gauge-value value">${value}</span>
    ${more ? html`<span class="gauge-more">${more}</span>` : nothing}
  </div>`;
}

function showState(state: State): TemplateResult {
  const show = state.status?.show;
  const phase = show?.phase ?? "idle";
  const frozen = phase === "running" ? halted(state.status) : "";
  const known = show === undefined ? "–" : frozen || texts.phases[phase];
  const lacks = phase === "running" && / in formation, without /.test(show?.reason ?? ""); // green is for all of it
  return html`<div class="show-state phase-${frozen || lacks ? "paused" : phase} value" data-testid="show-state" role="status" title=${showReason(state) || nothing}>
    ${icon(frozen ? "pause" : SHOW_ICON[phase])}
    <span class="show-words">
      <strong data-testid="show-phase">${known}</strong>
      <small data-testid="show-reason">${showReason(state)}</small>
    </span>
  </div>`;
}

/** What the phase is about. Of an uncontrolled fleet the number counts more than the words. */
export function showReason(state: State): string {
  const { show, counts } = state.status ?? {};
  if (show === undefined) return "";
  if (show.phase === "uncontrolled" && counts) return texts.bar.uncontrolled(counts.uncontrolled);
  return [show.selected?.name ?? "", show.reason].filter((each) => each !== "").join(": ");
}

function gauges(state: State): TemplateResult {
  const { frame, status } = state;
  const countdown_s = frame?.countdown_s ?? NaN;
  const isReady = !status?.alarms.some(({ cause, ended_unix_time_s }) => cause === "start-not-ready" && ended_unix_time_s === null);
  const counts = status?.counts;
  const floor_m = status?.flight_envelope.floor_horizontal_m;
  return html`<div class="gauges">
    ${Number.isFinite(countdown_s)
      ? html`<div class="gauge countdown ${isReady ? "" : "not-ready"}" data-testid="countdown">
          <span class="gauge-name">${isReady ? texts.bar.countdown : texts.bar.notReady}</span>
          <span class="gauge-value value">${minutes(Math.ceil(countdown_s))}</span>
        </div>`
      : nothing}
    <div class="gauge" data-testid="airborne">
      <span class="gauge-name">${texts.bar.airborne}</span>
      <span class="gauge-value value">${counts ? `${counts.airborne}/${status.vehicles.length}` : "–"}</span>
      ${counts && counts.unknown > 0 ? html`<span class="gauge-unknown value" data-testid="unknown">${texts.bar.unknown(counts.unknown)}</span>` : nothing}
    </div>
    ${gauge(
      texts.bar.separation,
      withUnit(frame?.minimumSeparation_m, "m"),
      "separation",
      floor_m === undefined ? "" : `${texts.bar.floor} ${withUnit(floor_m, "m")}`,
    )}
    ${gauge(texts.bar.center, withUnit(frame?.center_m?.[2], "m"), "center-height")}
  </div>`;
}

/** Of a site also the station that answers: another page may be that of another one. */
function roleAt(role: string, status: Status | null): string {
  const own = status?.stations.find((each) => each.own)?.name;
  return own === undefined ? role : texts.bar.roleAt(role, own);
}

function who(state: State): TemplateResult {
  const { access } = state;
  const right = (["operate", "emergency", "watch"] as const).find((each) => access?.rights.has(each));
  return html`<div class="who" data-testid="who" title=${access ? [...access.rights].join(", ") : ""}>
    ${icon("pilot")}
    <span class="gauge-words">
      <strong>${access?.name ?? "–"}</strong>
      <small data-testid="role">${right ? roleAt(texts.bar.roles[right], state.status) : "–"}</small>
    </span>
  </div>`;
}

export function topbar(state: State, actions: PanelActions): TemplateResult {
  const now = life(state);
  const { night } = state.view;
  return html`<header class="topbar">
    <h1 class="for-readers">${texts.title}</h1>
    <div class="life life-${now}" data-testid="connection" role="status" title=${state.connection.reason || nothing}>
      ${icon(LIFE_ICON[now])}<strong>${texts.bar.states[now]}</strong>
    </div>
    ${showState(state)} ${overall(state)} ${gauges(state)}
    <div class="spring"></div>
    ${button(actions, {
      id: "tools",
      label: texts.shell.more,
      icon: "more",
      iconOnly: true,
      kind: "quiet",
      expanded: state.panels.tools,
      press: () => actions.set({ tools: !state.panels.tools }),
    })}
    <div class="tools ${state.panels.tools ? "open" : ""}">
    ${isSmall(state.panels.layout) ? camera(state, actions) : nothing} ${soundButton(state, actions)} ${who(state)}
    <time class="clock value" data-testid="clock" title=${texts.bar.clock}>${clockTime(state.frame?.unix_time_s)}</time>
    ${button(actions, {
      id: "night",
      label: night ? texts.bar.toDay : texts.bar.toNight,
      icon: night ? "day" : "night",
      iconOnly: true,
      kind: "quiet",
      press: () => actions.view({ night: !night }),
    })}
    ${button(actions, {
      id: "help",
      label: texts.bar.help,
      icon: "question",
      iconOnly: true,
      kind: "quiet",
      expanded: state.panels.sheet === "help",
      press: () => actions.sheet("help"),
    })}
    </div>
  </header>`;
}
