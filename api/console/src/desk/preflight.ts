/** Preflight as a list of what to do: what fails first, with what was measured and what would pass. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PreflightReport, State } from "../state";
import { texts } from "../texts";
import type { DeskActions } from "./actions";
import { button, textField } from "./controls";
import { fixed, seconds } from "./format";
import { icon } from "./icons";
import { whyNot } from "./rights";

type Check = PreflightReport["fleet"][number];
type Vehicle = PreflightReport["vehicles"][number];

const t = texts.preflight;

/** How many checks keep the fleet on the ground; those of who does not fly do not. */
export function failures(report: PreflightReport): number {
  const failing = (checks: readonly Check[]): number => checks.filter((each) => each.state !== "pass").length;
  return failing(report.fleet) + report.vehicles.reduce((sum, each) => sum + (each.flies ? failing(each.checks) : 0), 0);
}

function check(one: Check): TemplateResult {
  const passes = one.state === "pass";
  const measured = one.value === null ? t.unknown : `${fixed(one.value, 2)} ${one.unit}`;
  return html`<li class="check check-${one.state}" data-testid="check-${one.state}">
    ${icon(passes ? "check" : one.state === "fail" ? "cross" : "question")}
    <div>
      <p class="check-name">
        <strong>${one.name}</strong>
        ${one.value !== null || one.state === "unknown" ? html`<span class="value">${measured}</span>` : nothing}
        ${one.limit ? html`<small>${t.limit}: ${one.limit}</small>` : nothing}
      </p>
      ${one.problem ? html`<p class="check-problem">${one.problem}</p>` : nothing}
      ${one.to_do && !passes ? html`<p class="check-do"><b>${t.toDo}:</b> ${one.to_do}</p>` : nothing}
    </div>
  </li>`;
}

function list(checks: readonly Check[], all: boolean): TemplateResult {
  const failing = checks.filter((each) => each.state !== "pass");
  const passing = checks.filter((each) => each.state === "pass");
  return html`<ul class="checks">
    ${failing.map(check)} ${all ? passing.map(check) : nothing}
  </ul>`;
}

function excluding(state: State, actions: DeskActions, id: string): TemplateResult {
  return html`<form
    class="inline-form"
    @submit=${(event: Event) => {
      event.preventDefault();
      actions.exclude(id);
    }}
  >
    ${textField(state, actions, { field: "exclude-reason", label: t.reason, focus: true })}
    <div class="buttons">
      <button type="submit" class="button primary" data-testid="exclude-confirm"><span>${t.exclude}</span></button>
      ${button(actions, { id: "exclude-cancel", label: texts.shell.cancel, kind: "quiet", press: () => actions.set({ excluding: null }) })}
    </div>
  </form>`;
}

function vehicle(state: State, actions: DeskActions, one: Vehicle): TemplateResult {
  const { allChecks, excluding: who } = state.desk;
  const failing = one.checks.filter((each) => each.state !== "pass").length;
  const passing = one.checks.length - failing;
  const good = one.flies && failing === 0;
  return html`<section class="preflight-vehicle ${one.flies ? "" : "out"}" data-testid="preflight-${one.id}">
    <header>
      ${icon(!one.flies ? "offline" : good ? "check" : "cross")}
      <h4><button type="button" class="link" @click=${() => actions.select(one.id)}>${one.id}</button></h4>
      <span class="summary">
        ${one.flies ? (good ? t.allPass(passing) : t.fails(failing)) : html`${t.excluded}: ${one.reason}`}
      </span>
      ${one.flies
        ? button(actions, {
            id: `exclude-${one.id}`,
            label: t.exclude,
            name: t.excludeOne(one.id),
            kind: "quiet",
            why: whyNot(state, "exclude"),
            expanded: who === one.id,
            press: () => actions.set({ excluding: who === one.id ? null : one.id }),
          })
        : button(actions, {
            id: `include-${one.id}`,
            label: t.include,
            name: t.includeOne(one.id),
            kind: "quiet",
            why: whyNot(state, "include"),
            press: () => actions.include(one.id),
          })}
    </header>
    ${who === one.id ? excluding(state, actions, one.id) : nothing}
    ${one.flies || allChecks ? list(one.checks, allChecks) : nothing}
  </section>`;
}

/** Who has to be mended first, then who stays down, then the others. */
function rank(one: Vehicle): number {
  if (!one.flies) return 1;
  return one.passes ? 2 : 0;
}

function report(state: State, actions: DeskActions, found: PreflightReport): TemplateResult {
  const count = failures(found);
  const { allChecks } = state.desk;
  return html`<div class="verdict ${found.passes ? "good" : "bad"}" role="status" data-testid="preflight-verdict">
      ${icon(found.passes ? "check" : "cross")}
      <strong>${found.passes ? t.passes : t.fails(count)}</strong>
      <small>${t.read(seconds((state.page_ms - state.desk.preflightRead_ms) / 1000))}</small>
    </div>
    <section>
      <h3>${t.fleet}</h3>
      ${list(found.fleet, true)}
    </section>
    <section>
      ${[...found.vehicles].sort((a, b) => rank(a) - rank(b)).map((one) => vehicle(state, actions, one))}
    </section>
    ${found.not_checked.length
      ? html`<section>
          <h3>${t.notChecked}</h3>
          <ul class="plain dim">
            ${found.not_checked.map((text) => html`<li>${text}</li>`)}
          </ul>
        </section>`
      : nothing}
    ${button(actions, {
      id: "checks-all",
      label: allChecks ? t.hidden : t.shown,
      kind: "quiet",
      pressed: allChecks,
      press: () => actions.set({ allChecks: !allChecks }),
    })}`;
}

export function preflight(state: State, actions: DeskActions): TemplateResult {
  return html`<div class="preflight" data-testid="preflight">
    ${state.desk.preflightProblem ? html`<p class="problem" role="alert" data-testid="preflight-problem">${state.desk.preflightProblem}</p>` : nothing}
    ${state.preflight ? report(state, actions, state.preflight) : html`<p class="empty">${t.none}</p>`}
    ${button(actions, { id: "preflight-read", label: t.again, press: () => actions.readPreflight() })}
  </div>`;
}
