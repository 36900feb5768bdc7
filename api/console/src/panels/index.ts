/** The panels around the scene: a pure function of the state. */

import { html, nothing, type TemplateResult } from "lit-html";
import { features, panelsOf } from "../features";
import { flightReport } from "../replay/report";
import { drawnBar } from "../drawn/bar";
import { placingBar } from "../placing/panel";
import { replayBar } from "../replay/bar";
import type { State, Status } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { alarmsOf } from "../alarms/model";
import { alarms, announcer } from "../alarms/panel";
import { offers, recovery } from "../alarms/recovery";
import { begin, beginStrip } from "./begin";
import { banner, toasts } from "./banners";
import { camera } from "./camera";
import { button } from "./controls";
import { energy } from "./energy";
import { events } from "./events";
import { fleet } from "./fleet";
import { flight } from "./flight";
import { previewBar } from "./preview";
import { help } from "./help";
import { icon, type IconName } from "./icons";
import { PANEL_KEYS } from "../keys";
import { kill } from "./kill";
import { DEAD_IN_REPLAY, isBesideAPanel, isSmall, shownPanels } from "./layout";
import { login } from "./login";
import { obstacles } from "./obstacles";
import { plots } from "./plots";
import { failures, preflight, preflightNow } from "./preflight";
import { shape } from "./shape";
import { shows } from "./shows";
import { start } from "./start";
import type { FeaturePanelName, LeftPanel, RightPanel, Sheet } from "./state";
import { isSite, missing, stations } from "./stations";
import { whyNot } from "./rights";
import { timeline } from "../timeline/strip";
import { life, topbar } from "./topbar";
import { vehicle } from "./vehicle";

type View = (state: State, actions: PanelActions) => TemplateResult;
type PanelName = LeftPanel | RightPanel;

const LEFT: readonly LeftPanel[] = ["preflight", "shows", "shape", "obstacles"];
const RIGHT: readonly RightPanel[] = ["fleet", "vehicle", "events", "plots"];

function rightTabs(status: Status | null): readonly RightPanel[] {
  return [...RIGHT, ...(isSite(status) ? (["stations"] as const) : []), ...panelsOf(status).map((each) => each.name), ...(status?.replay ? (["report"] as const) : [])];
}

const PANELS: Record<Exclude<PanelName, FeaturePanelName>, { view: View; icon: IconName }> = {
  preflight: { view: preflight, icon: "preflight" },
  shows: { view: shows, icon: "show" },
  shape: { view: shape, icon: "shape" },
  obstacles: { view: obstacles, icon: "obstacle" },
  fleet: { view: fleet, icon: "fleet" },
  vehicle: { view: vehicle, icon: "vehicle" },
  events: { view: events, icon: "events" },
  plots: { view: plots, icon: "plots" },
  stations: { view: stations, icon: "station" },
  report: { view: flightReport, icon: "check" },
};

/** Of the page, or of a feature. */
function panelNamed(name: PanelName): { title: string; view: View; icon: IconName } {
  const panel = features.find((each) => each.panel?.name === name)?.panel;
  if (panel !== undefined) return { ...panel, view: (state, actions) => panel.view(state, actions, whyNot(state, "feature")) };
  const own = name as keyof typeof PANELS;
  return { ...PANELS[own], title: texts.shell.tabs[own] };
}

const SHEETS: Record<Sheet, { view: View; title: string }> = {
  start: { view: start, title: texts.start.title },
  begin: { view: begin, title: texts.begin.title },
  kill: { view: kill, title: texts.kill.title },
  help: { view: help, title: texts.help.title },
};

/** A number beside the name of a panel that needs attention. */
function count(state: State, name: PanelName): number {
  const report = name === "preflight" ? preflightNow(state) : null;
  if (report && !report.passes) return failures(report);
  if (name === "stations") return missing(state.status).length;
  if (name === "obstacles") return state.status?.obstacles.length ?? 0;
  return 0;
}

function rail(state: State, actions: PanelActions, side: "left" | "right", names: readonly PanelName[]): TemplateResult {
  const open = shownPanels(state.panels)[side];
  const keys = Object.entries(PANEL_KEYS);
  return html`<nav class="rail rail-${side}" aria-label=${texts.shell[side]}>
    ${names.map((name) => {
      const key = keys.find(([, panel]) => panel === name)?.[0];
      const number = count(state, name);
      const { title, icon: sign } = panelNamed(name);
      return html`<button
        type="button"
        class="tab"
        data-testid="tab-${name}"
        aria-expanded=${String(open === name)}
        aria-keyshortcuts=${key ?? nothing}
        title=${key ? `${title} (${key})` : nothing}
        @click=${() => actions.togglePanel(name)}
      >
        ${icon(sign)}<span>${title}</span>
        ${number > 0 ? html`<b class="badge ${name === "obstacles" ? "" : "bad"}">${number}</b>` : nothing}
      </button>`;
    })}
  </nav>`;
}

function panel(state: State, actions: PanelActions, side: "left" | "right"): TemplateResult | typeof nothing {
  const name = shownPanels(state.panels)[side];
  if (name === null) return nothing;
  const { layout, tall } = state.panels;
  const { title, view } = panelNamed(name);
  return html`<aside class="panel panel-${side} panel-${name}" aria-label=${title} data-testid="panel-${name}">
    <header>
      <h2>${title}</h2>
      ${isSmall(layout)
        ? button(actions, {
            id: "panel-size",
            label: tall ? texts.shell.smaller(title) : texts.shell.larger(title),
            icon: tall ? "down" : "up",
            iconOnly: true,
            kind: "quiet",
            expanded: tall,
            press: () => actions.set({ tall: !tall }),
          })
        : nothing}
      ${button(actions, {
        id: `close-${side}`,
        label: texts.shell.closePanel(title),
        icon: "cross",
        iconOnly: true,
        kind: "quiet",
        press: () => actions.togglePanel(name),
      })}
    </header>
    <div class="panel-body" tabindex=${name === "fleet" ? nothing : "0"} role=${name === "fleet" ? nothing : "region"} aria-label=${name === "fleet" ? nothing : title}>${view(state, actions)}</div>
  </aside>`;
}

function sheet(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const name = state.panels.sheet;
  if (name === null) return nothing;
  return html`<section class="sheet sheet-${name}" role="dialog" aria-label=${SHEETS[name].title} data-testid="sheet-${name}">
    <div class="head">
      <h2>${SHEETS[name].title}</h2>
      ${button(actions, { id: "sheet-close", label: texts.shell.close, icon: "cross", iconOnly: true, kind: "quiet", focus: name === "help", press: () => actions.sheet(null) })}
    </div>
    ${SHEETS[name].view(state, actions)}
  </section>`;
}

/** The timeline, which seeks in a replay, or a preview in its place. Where there is little room, what is being placed takes it. */
function band(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  if (state.placing !== null && isSmall(state.panels.layout)) return nothing;
  if (state.drawn !== null) return drawnBar(state, actions);
  return state.status?.replay ? replayBar(state, actions) : timeline(state, actions);
}

export function panels(state: State, actions: PanelActions): TemplateResult {
  const now = life(state);
  const isReplay = Boolean(state.status?.replay);
  const isOld = now !== "live" && now !== "replay";
  const { left, right } = shownPanels(state.panels);
  const { layout, tall, allAlarms, sheet: open } = state.panels;
  const hasAlarms = alarmsOf(state.status).length > 0;
  const names = [
    "panels",
    isOld && "is-old",
    left && "has-left",
    right && "has-right",
    tall && "is-tall",
    allAlarms && hasAlarms ? "has-all-alarms" : isBesideAPanel(state.panels) && "has-dense-alarms",
    open && open !== "help" && "has-dialog",
  ];
  return html`<div class=${names.filter(Boolean).join(" ")} data-testid="panels" data-life=${now} data-layout=${layout}>
    ${topbar(state, actions)}
    <div class="banners">${banner(state)} ${features.map((each) => each.strip?.(state, actions, whyNot(state, "feature")) ?? nothing)} ${beginStrip(state, actions)}</div>
    ${isSmall(layout) ? nothing : recovery(state)}
    <div class="alarms" data-region="alarms">${isSmall(layout) ? recovery(state) : nothing} ${alarms(state, actions)}</div>
    <div class="rails">
      ${rail(state, actions, "left", isReplay ? LEFT.filter((each) => !DEAD_IN_REPLAY.has(each)) : LEFT)} ${rail(state, actions, "right", rightTabs(state.status))}
    </div>
    ${panel(state, actions, "left")} ${panel(state, actions, "right")}
    <section class="room" data-room aria-label=${texts.shell.room}><div class="room-low">${features.map((each) => each.glance?.(state) ?? nothing)} ${energy(state)} ${isSmall(layout) ? nothing : camera(state, actions)}</div></section>
    <div class="center-low">${sheet(state, actions)} ${previewBar(state, actions)} ${toasts(state, actions)}</div>
    <footer class="bottom">${placingBar(state, actions)} ${band(state, actions)} ${isReplay ? nothing : html`${offers(state, actions)} ${flight(state, actions)}`}</footer>
    ${login(state, actions)} ${announcer(state)}
  </div>`;
}
