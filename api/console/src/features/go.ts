/** What people say before a start: a proposed start to confirm, checklists to sign, the weather to enter. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PanelActions } from "../panels/actions";
import { button, numberField, twice } from "../panels/controls";
import { clockTime, parsed, UNKNOWN } from "../panels/format";
import { icon } from "../panels/icons";
import type { Features, State } from "../state";
import type { Feature, FeaturePanel } from "./feature";

type Go = NonNullable<Features["go"]>;
type Proposal = NonNullable<Go["proposal"]>;

export const t = {
  title: "Start by two",
  panel: "Checklists",
  proposed: (by: string): string => `Start proposed by ${by}`,
  left: (left_s: number): string => `${left_s} s left`,
  hash: (hash: string): string => `hash ${hash}`,
  confirm: "Confirm",
  sure: (count: number): string => `Yes, ${count} take off`,
  own: "you have proposed it: another token confirms it",
  over: "its time is over: propose it again",
  confirmed: "The start is confirmed",
  noGo: "NO GO",
  elsewhere: "Checklists and weather count where the show is led, not here.",
  ended: (why: string): string => `The proposed start is over: ${why}.`,
  open: (count: number, all: number): string => `${count} of ${all} open`,
  signed: (by: string, at: string): string => `${by}, ${at}`,
  sign: "Sign",
  reopen: "Open again",
  isSigned: "Signed",
  isOpen: "Open again",
  weather: "Weather",
  entered: (by: string, at: string): string => `Entered by ${by} at ${at}`,
  notEntered: "Not entered",
  enter: "Enter weather",
  noNumber: (label: string): string => `${label}: type a number`,
  noWeather: "type at least one number",
  isEntered: "The weather is entered",
};

const NAME = "feature-go";

/** Whole seconds that a proposal has left; 0: none. Pure. */
export const left_s = (proposal: Proposal, now_s: number): number => Math.max(0, Math.ceil(proposal.until_unix_time_s - now_s));

/** Why this page cannot confirm it; "" where it can. Pure. */
export function whyNotConfirm(state: State, proposal: Proposal, why: string): string {
  if (why !== "") return why;
  if (state.access?.name === proposal.by) return t.own;
  return left_s(proposal, state.frame?.unix_time_s ?? NaN) > 0 ? "" : t.over;
}

function strip(state: State, actions: PanelActions, why: string): TemplateResult | null {
  const proposal = state.status?.features.go?.proposal;
  if (!proposal || state.status?.replay) return null;
  return html`<section class="strip go-strip" aria-label=${t.title} data-testid="go">
    <div class="strip-words">
      <span class="strip-group">
        ${icon("start")}<span data-testid="go-by">${t.proposed(proposal.by)}</span>
        <span class="value big-figure" data-testid="go-left">${t.left(left_s(proposal, state.frame?.unix_time_s ?? NaN))}</span>
        <span class="dim mono" data-testid="go-hash">${t.hash(proposal.hash)}</span>
      </span>
    </div>
    ${twice(state, actions, {
      id: "go-confirm",
      label: t.confirm,
      sure: t.sure(proposal.vehicles),
      about: `go:${proposal.hash}`,
      why: whyNotConfirm(state, proposal, why),
      press: () => void actions.ask(t.confirm, (api) => api.POST("/api/v1/show/confirm", { body: { hash: proposal.hash } }), t.confirmed),
    })}
  </section>`;
}

function checklist(actions: PanelActions, { role, items }: Go["checklists"][number], why: string): TemplateResult {
  const open = items.filter((each) => each.by === "").length;
  return html`<li class="card" data-testid="checklist-${role}">
    <header>
      <h3>${role}</h3>
      <strong class="card-state ${open === 0 ? "good" : "bad"}">${icon(open === 0 ? "check" : "warning")} ${t.open(open, items.length)}</strong>
    </header>
    <ol>
      ${items.map(({ text, by, unix_time_s }, row) => {
        const body = { role, items: [row + 1] };
        const id = `${role}-${row + 1}`;
        return html`<li>
          <p>${text}</p>
          ${by === ""
            ? button(actions, {
                id: `sign-${id}`, label: t.sign, name: `${t.sign}: ${text}`, why,
                press: () => void actions.ask(t.sign, (api) => api.POST("/api/v1/go/sign", { body }), t.isSigned),
              })
            : html`<p class="dim" data-testid="signed-${id}">${t.signed(by, unix_time_s === null ? UNKNOWN : clockTime(unix_time_s))}</p>
                ${button(actions, {
                  id: `reopen-${id}`, label: t.reopen, name: `${t.reopen}: ${text}`, why,
                  press: () => void actions.ask(t.reopen, (api) => api.POST("/api/v1/go/reopen", { body }), t.isOpen),
                })}`}
        </li>`;
      })}
    </ol>
  </li>`;
}

const QUANTITIES = [
  ["wind_m_s", "Wind", "m/s"],
  ["gust_m_s", "Gusts", "m/s"],
  ["visibility_m", "Visibility", "m"],
  ["kp", "Kp", ""],
] as const;

/** What is typed as weather, without what is empty or no number. Pure. */
export function typedWeather({ panels }: State): Partial<Record<(typeof QUANTITIES)[number][0], number>> {
  const given = QUANTITIES.map(([key]) => [key, parsed(panels.drafts[`weather:${key}`] ?? "")] as const);
  return Object.fromEntries(given.filter(([, value]) => value !== null));
}

/** Why what is typed is not entered; "" where it is. A field that was emptied is not known. Pure. */
export function whyNotEntered(state: State): string {
  const typed = QUANTITIES.map(([key, label]) => [label, (state.panels.drafts[`weather:${key}`] ?? "").trim()] as const);
  const wrong = typed.find(([, text]) => text !== "" && parsed(text) === null);
  if (wrong !== undefined) return t.noNumber(wrong[0]);
  return typed.every(([, text]) => text === "") ? t.noWeather : "";
}

function weather(state: State, actions: PanelActions, { weather: entry }: Go, why: string): TemplateResult {
  const body = typedWeather(state);
  const enter = (): void => {
    actions.undo("weather:");
    void actions.ask(t.enter, (api) => api.PUT("/api/v1/go/weather", { body }), t.isEntered);
  };
  return html`<section class="weather">
    <h3>${t.weather}</h3>
    <p class="hint" data-testid="weather-entered">${entry === null ? t.notEntered : t.entered(entry.by, clockTime(entry.unix_time_s))}</p>
    <div class="fields">
      ${QUANTITIES.map(([key, label, unit]) => numberField(state, actions, { field: `weather:${key}`, label, unit, value: entry?.[key]?.toString() ?? "" }))}
    </div>
    <div class="buttons">
      ${button(actions, { id: "weather-enter", label: t.enter, why: why || whyNotEntered(state), press: enter })}
    </div>
  </section>`;
}

function view(state: State, actions: PanelActions, why: string): TemplateResult {
  const go = (state.features ?? state.status?.features)?.go;
  if (!go) return html`${nothing}`;
  return html`<div data-testid="go-panel">
    ${go.missing.length === 0
      ? nothing
      : html`<section class="problem" aria-label=${t.noGo} data-testid="go-missing">
          <p>${icon("warning")} <strong>${t.noGo}</strong></p>
          <ul>${go.missing.map((each) => html`<li>${each}</li>`)}</ul>
        </section>`}
    ${go.decides ? nothing : html`<p class="hint" data-testid="go-elsewhere">${t.elsewhere}</p>`}
    ${go.ended === "" ? nothing : html`<p class="hint" data-testid="go-ended">${t.ended(go.ended)}</p>`}
    <ul class="cards">
      ${go.checklists.map((each) => checklist(actions, each, why))}
    </ul>
    ${weather(state, actions, go, why)}
  </div>`;
}

const panel: FeaturePanel = { name: NAME, title: t.panel, icon: "check", view };

export const go: Feature = { strip, panel, isRead: ({ features }) => features.go !== null };
