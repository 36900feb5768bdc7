/** Preflight as a list of causes: what follows from one is folded under it, with the command that mends most. */

import { html, nothing, type TemplateResult } from "lit-html";
import { guard } from "lit-html/directives/guard.js";
import type { PreflightReport, State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button, textField } from "./controls";
import { percent, plain, seconds } from "./format";
import { icon } from "./icons";
import { whyNot, whyNotOnGround } from "./rights";

type Check = PreflightReport["fleet"][number];
type Vehicle = PreflightReport["vehicles"][number];
type Cause = PreflightReport["causes"][number];

const t = texts.preflight;

/** What a report says of itself once nothing fails. */
const READY = "ready";

/** How long a report counts as what is so now, and not as what was. */
const NEW_MS = 12_000;

/** The report while it is current: on the ground, and read a short while ago. Pure. */
export function preflightNow(state: State): PreflightReport | null {
  const isNew = state.page_ms - state.panels.preflightRead_ms < NEW_MS; // NaN: not yet
  return isNew && whyNotOnGround(state) === "" ? state.preflight : null;
}

/** The report for a start of these vehicles (null: of every one that is online); null: there is no current one. Pure. */
export function preflightOf(state: State, vehicles: readonly string[] | null): PreflightReport | null {
  return state.panels.preflightFor === reportKey(vehicles) ? preflightNow(state) : null;
}

export const reportKey = (vehicles: readonly string[] | null): string => vehicles?.join(" ") ?? "";

/** How many causes keep the fleet on the ground. */
export const failures = (report: PreflightReport): number => report.causes.length;

function measured(check: Check): string {
  if (check.value === null) return "";
  return check.unit === "of 1" ? percent(check.value) : `${plain(check.value)} ${check.unit}`.trim();
}

function checkView(one: Check): TemplateResult {
  const passes = one.state === "pass";
  const value = one.unit === "" ? "" : measured(one);
  return html`<li class="check check-${one.state}" data-testid="check-${one.state}">
    ${icon(passes ? "check" : one.state === "fail" ? "cross" : "question")}
    <div>
      <p class="check-name">
        <strong>${one.name}</strong>
        ${value ? html`<span class="value">${value}</span>` : nothing}
        ${one.state === "unknown" ? html`<span>${t.unknown}</span>` : nothing}
        ${one.limit ? html`<small>${t.limit}: ${one.limit}</small>` : nothing}
      </p>
      ${one.problem ? html`<p class="check-problem">${one.problem}</p>` : nothing}
      ${one.to_do && !passes ? html`<p class="check-do"><b>${t.toDo}:</b> ${one.to_do}</p>` : nothing}
    </div>
  </li>`;
}

const NAMED_MAX = 12;

/** The value that fails, of a vehicle of a cause. */
function valueOf(found: PreflightReport, cause: Cause, id: string): string {
  const check = found.vehicles.find((each) => each.id === id)?.checks.find((each) => each.name === cause.check && each.state !== "pass");
  return check === undefined || check.unit === "" ? "" : measured(check);
}

function whoView(actions: PanelActions, found: PreflightReport, cause: Cause): TemplateResult | typeof nothing {
  if (cause.vehicles.length < 2) return nothing; // one is named in the text
  const more = cause.vehicles.length - NAMED_MAX;
  return html`<p class="check-who">
    ${cause.vehicles.slice(0, NAMED_MAX).map((id) => {
      const value = valueOf(found, cause, id);
      return html`<button type="button" class="link" @click=${() => actions.select(id)}>${id}</button>${value
          ? html` <span class="value">${value}</span>`
          : nothing} `;
    })}
    ${more > 0 ? t.moreVehicles(more) : nothing}
    <button
      type="button"
      class="link"
      data-testid="select-problem"
      @click=${() => actions.choose({ how: "only", ids: cause.vehicles })}
    >
      ${texts.selection.selectAll(cause.vehicles.length)}
    </button>
  </p>`;
}

/** One cause: what is wrong, the command that mends it and what remains then, and what follows from it. */
function causeView(state: State, actions: PanelActions, found: PreflightReport, cause: Cause, index: number): TemplateResult {
  const { action } = cause;
  return html`<li class="check cause check-${cause.state}" data-testid="cause">
    ${icon(cause.state === "fail" ? "cross" : "question")}
    <div>
      <p class="cause-text">
        ${cause.vehicles.length === 1
          ? html`<button type="button" class="link" @click=${() => actions.select(cause.vehicles[0]!)}>${cause.text}</button>`
          : html`<strong>${cause.text}</strong>`}
      </p>
      ${whoView(actions, found, cause)}
      ${cause.to_do ? html`<p class="check-do"><b>${t.toDo}:</b> ${cause.to_do}</p>` : nothing}
      ${action
        ? html`<div class="cause-action">
            ${button(actions, {
              id: `mend-${index}`,
              label: action.label,
              why: whyNot(state, action.remedy) || whyNotOnGround(state),
              press: () => actions.mend(action),
            })}
            ${action.then ? html`<span class="cause-then ${action.then === READY ? "good" : ""}">${t.then(action.then)}</span>` : nothing}
          </div>`
        : nothing}
      ${cause.follows.length
        ? html`<details>
            <summary>${t.follows(cause.follows.length)}</summary>
            <ul class="plain dim">
              ${cause.follows.map((text) => html`<li>${text}</li>`)}
            </ul>
          </details>`
        : nothing}
    </div>
  </li>`;
}

function excluding(state: State, actions: PanelActions, id: string): TemplateResult {
  return html`<form
    class="inline-form"
    @submit=${(event: Event) => {
      event.preventDefault();
      actions.exclude(id);
    }}
  >
    ${textField(state, actions, { field: "exclude-reason", label: t.reason, focus: true })}
    <div class="buttons">
      <button type="submit" class="button primary" data-testid="exclude-confirm"><span>${t.excludeOne(id)}</span></button>
      ${button(actions, { id: "exclude-cancel", label: texts.shell.cancel, kind: "quiet", press: () => actions.set({ excluding: null }) })}
    </div>
  </form>`;
}

/** `blamed`: it has a cause, or is one; what else it fails follows from others, and leaving it out mends nothing. */
function vehicle(state: State, actions: PanelActions, one: Vehicle, blamed: boolean): TemplateResult {
  const { allChecks, excluding: who } = state.panels;
  const failing = one.checks.filter((each) => each.state !== "pass").length;
  const good = one.flies && failing === 0;
  return html`<section class="preflight-vehicle ${one.flies ? (good ? "good" : "bad") : "out"}" data-testid="preflight-${one.id}">
    <header>
      ${icon(!one.flies ? "offline" : good ? "check" : "cross")}
      <h4><button type="button" class="link" @click=${() => actions.select(one.id)}>${one.id}</button></h4>
      <span class="summary">
        ${one.flies ? (good ? t.allPass(one.checks.length) : blamed ? t.fails(failing) : t.followsOnly) : html`${t.excluded}: ${one.reason}`}
      </span>
      ${one.flies && !good && !blamed
        ? nothing
        : one.flies
        ? button(actions, {
            id: `exclude-${one.id}`,
            label: t.exclude,
            name: t.excludeOne(one.id),
            kind: "quiet",
            why: whyNot(state, "exclude") || whyNotOnGround(state),
            expanded: who === one.id,
            press: () => actions.set({ excluding: who === one.id ? null : one.id }),
          })
        : button(actions, {
            id: `include-${one.id}`,
            label: t.include,
            name: t.includeOne(one.id),
            kind: "quiet",
            why: whyNot(state, "include") || whyNotOnGround(state),
            press: () => actions.include(one.id),
          })}
    </header>
    ${who === one.id ? excluding(state, actions, one.id) : nothing}
    ${allChecks ? html`<ul class="checks">${one.checks.map((each) => checkView(each))}</ul>` : nothing}
  </section>`;
}

const VEHICLES_MAX = 60;

function vehicleList(state: State, actions: PanelActions, list: readonly Vehicle[], blamed: ReadonlySet<string>): TemplateResult {
  return html`${list.slice(0, VEHICLES_MAX).map((one) => vehicle(state, actions, one, blamed.has(one.id)))}
  ${list.length > VEHICLES_MAX ? html`<p class="dim">${t.moreVehicles(list.length - VEHICLES_MAX)}</p>` : nothing}`;
}

/** Passed checks are one line until the operator opens it: a start is prepared by the failed ones. */
function passing(state: State, actions: PanelActions, vehicles: readonly Vehicle[], checks: readonly Check[]): TemplateResult | typeof nothing {
  const { allChecks } = state.panels;
  if (vehicles.length + checks.length === 0) return nothing; // nothing passed is no pass
  return html`<section class="preflight-passing" data-testid="preflight-passing">
    <h3>${t.passing}</h3>
    <p class="verdict">${icon("check")} <span>${t.passingWhat(vehicles.length, checks.length)}</span></p>
    ${button(actions, {
      id: "checks-all",
      label: allChecks ? t.hidden : t.shown,
      kind: "quiet",
      expanded: allChecks,
      press: () => actions.set({ allChecks: !allChecks }),
    })}
    ${allChecks
      ? html`${vehicleList(state, actions, vehicles, new Set())}
          <ul class="checks">
            ${checks.map((each) => checkView(each))}
          </ul>`
      : nothing}
  </section>`;
}

/** What to mend, which vehicles stay on the ground, and what passes. */
export function details(state: State, actions: PanelActions, found: PreflightReport): TemplateResult {
  const isGood = (one: Vehicle): boolean => one.flies && one.checks.every((each) => each.state === "pass");
  const rest = found.vehicles.filter((one) => !isGood(one));
  const blamed = new Set(found.causes.flatMap((each) => each.vehicles));
  const place = (one: Vehicle): number => (!one.flies ? 1 : blamed.has(one.id) ? 0 : 2); // innocent ones last
  const open = [...rest].sort((a, b) => place(a) - place(b));
  return html`${found.causes.length
      ? html`<section data-testid="preflight-todo">
          <h3>${t.todo}</h3>
          <ul class="checks">
            ${found.causes.map((each, index) => causeView(state, actions, found, each, index))}
          </ul>
        </section>`
      : nothing}
    ${open.length
      ? html`<section data-testid="preflight-open">
          <h3>${t.vehicles}</h3>
          ${vehicleList(state, actions, open, blamed)}
        </section>`
      : nothing}
    ${passing(state, actions, found.vehicles.filter(isGood), found.fleet.filter((each) => each.state === "pass"))}
    ${found.not_checked.length
      ? html`<section>
          <h3>${t.notChecked}</h3>
          <ul class="plain dim">
            ${found.not_checked.map((text) => html`<li>${text}</li>`)}
          </ul>
        </section>`
      : nothing}`;
}

/** With 200 vehicles the list is long: it is rendered again when it changed, and not ten times a second. */
function report(state: State, actions: PanelActions, found: PreflightReport): TemplateResult {
  const { allChecks, excluding: who, drafts } = state.panels;
  const onGround = whyNotOnGround(state);
  const shown = [found, allChecks, who, drafts["exclude-reason"], onGround, whyNot(state, "exclude"), whyNot(state, "include")];
  const flying = found.fleet.find((each) => each.name === "vehicles")?.value ?? 0;
  const verdict = found.passes ? t.passes : failures(found) > 0 ? t.fails(failures(found)) : t.noVehicles;
  return html`<div class="verdict ${onGround !== "" ? "" : found.passes ? "good" : "bad"}" role="status" data-testid="preflight-verdict">
      ${icon(onGround !== "" ? "info" : found.passes ? "check" : "cross")}
      <strong>${onGround !== "" ? t.flies : verdict}</strong>
      <span>${t.of(flying, found.vehicles.length)}</span>
      <small>${onGround === "" ? "" : `${t.before}; `}${t.read(seconds((state.page_ms - state.panels.preflightRead_ms) / 1000))}</small>
    </div>
    ${guard(shown, () => details(state, actions, found))}`;
}

export function preflight(state: State, actions: PanelActions): TemplateResult {
  return html`<div class="preflight" data-testid="preflight">
    ${state.panels.preflightProblem ? html`<p class="problem" role="alert" data-testid="preflight-problem">${state.panels.preflightProblem}</p>` : nothing}
    ${state.preflight ? report(state, actions, state.preflight) : html`<p class="empty">${t.none}</p>`}
    ${button(actions, { id: "preflight-read", label: t.again, press: () => actions.readPreflight() })}
  </div>`;
}
