/** What a recorded flight kept and what it broke. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PanelActions } from "../panels/actions";
import { button } from "../panels/controls";
import { fixed, minutes, withUnit } from "../panels/format";
import { icon } from "../panels/icons";
import type { ReportBody, State } from "../state";
import { texts } from "../texts";

const t = texts.flightReport;

function moment(actions: PanelActions, at_s: number | null): TemplateResult | typeof nothing {
  if (at_s === null) return nothing;
  return html`<button
    type="button"
    class="link"
    title=${t.goto}
    aria-label="${t.goto}: ${minutes(at_s)}"
    @click=${() => actions.replay({ position_s: at_s, paused: true })}
  >
    ${minutes(at_s)}
  </button>`;
}

function head(names: readonly string[]): TemplateResult {
  return html`<thead>
    <tr>
      ${names.map((name) => html`<th scope="col">${name}</th>`)}
    </tr>
  </thead>`;
}

const LEEWAY_REPORTED = 1.01; // less is rounding

/** A limit that nothing was judged by is neither. */
const rowClass = (kept: boolean | null): string => (kept === null ? "unjudged" : kept ? "kept" : "broken");

const VERDICTS = {
  kept: { mark: "check", kind: "good", text: t.kept },
  broken: { mark: "cross", kind: "bad", text: t.broken },
  incomplete: { mark: "warning", kind: "unsure", text: t.incomplete },
} as const;

/** How a verdict is shown: only what was judged from beginning to end is green. */
/** Which autopilots flew, in brackets; "" where the record names none. */
export function autopilots(found: Pick<ReportBody, "autopilots">): string {
  const kinds = Object.entries(found.autopilots).map(([name, count]) => `${count} ${name}`);
  return kinds.length > 0 ? ` (${kinds.join(", ")})` : "";
}

export const verdict = (found: Pick<ReportBody, "verdict">): (typeof VERDICTS)[keyof typeof VERDICTS] => VERDICTS[found.verdict];

function checks(actions: PanelActions, flightReport: ReportBody): TemplateResult {
  return html`<table class="plain-table" data-testid="report-checks">
    <caption>${t.checks}</caption>
    ${head([t.name, t.worst, t.limit, t.who])}
    <tbody>
      ${flightReport.checks.map(
        (each) => html`<tr class=${rowClass(each.kept)}>
          <th scope="row">
            ${each.kept === null ? nothing : icon(each.kept ? "check" : "cross")}${each.name}<span class="for-readers">: ${each.kept === null ? t.nothing : each.kept ? t.keptShort : t.brokenShort}</span>
          </th>
          <td class="number">${each.worst === null ? t.nothing : fixed(each.worst, 2)}</td>
          <td class="number">${fixed(each.limit, 2)} ${each.unit} ${(each.tolerated ?? 0) <= (each.limit ?? 0) * LEEWAY_REPORTED ? nothing : html`<small>${t.tolerated(fixed(each.tolerated, 2))}</small>`}</td>
          <td>${each.vehicle} ${moment(actions, each.at_s)}</td>
        </tr>`,
      )}
    </tbody>
  </table>`;
}

function pairs(actions: PanelActions, flightReport: ReportBody): TemplateResult {
  return html`<table class="plain-table" data-testid="report-pairs">
    <caption>${t.nearest}</caption>
    ${head([t.pair, t.distance, t.ratio, t.ratioOff, t.at])}
    <tbody>
      ${flightReport.nearest_pairs.map(
        (pair) => html`<tr>
          <th scope="row">${pair.vehicles.join(" – ")}</th>
          <td class="number">${withUnit(pair.distance_m, "m", 2)}</td>
          <td class="number">${fixed(pair.floor_ratio, 2)}×</td>
          <td class="number">${fixed(pair.floor_ratio_if_off, 2)}×</td>
          <td>${moment(actions, pair.at_s)}</td>
        </tr>`,
      )}
    </tbody>
  </table>`;
}

function tracked(actions: PanelActions, each: ReportBody["tracking"][number]): TemplateResult {
  return html`<p data-testid="report-tracking">
    ${t.tracked(each.target, [each.median_m, each.p95_m, each.worst_m].map((value) => withUnit(value, "m", 2)))} ${moment(actions, each.worst_at_s)}
    <small>${t.trackedFor([each.followed_s, each.approach_s, each.coasting_s, each.lost_s].map((value) => fixed(value, 0)), withUnit(each.deviation_m, "m", 2))}</small>
  </p>`;
}

function judged(actions: PanelActions, found: ReportBody): TemplateResult {
  const { mark, kind, text } = verdict(found);
  return html`<div class="verdict ${kind}" data-testid="report-verdict">
      ${icon(mark)}
      <strong>${text}</strong>
      <small>${t.flew(found.flew, found.vehicles)}${autopilots(found)}, ${minutes(found.duration_s)}</small>
    </div>
    ${found.missing.length === 0
      ? nothing
      : html`<div class="problem" data-testid="report-missing">
          <p>${t.missing}</p>
          <ul>
            ${found.missing.map((each) => html`<li>${each}</li>`)}
          </ul>
        </div>`}
    <p class="dim">${t.basedOn} ${found.based_on}: ${found.uncertainty}</p>
    ${found.remarks.map((text) => html`<p class="hint">${text}</p>`)} ${checks(actions, found)} ${pairs(actions, found)} ${found.tracking.map((each) => tracked(actions, each))}`;
}

export function flightReport(state: State, actions: PanelActions): TemplateResult {
  const { reportProblem, reportReading } = state.panels;
  return html`<div data-testid="report">
    ${reportProblem ? html`<p class="problem" role="alert">${reportProblem}</p>` : nothing}
    ${state.flightReport
      ? judged(actions, state.flightReport)
      : html`<p class="empty">${reportReading ? t.reading : t.none}</p>`}
    ${button(actions, {
      id: "report-read",
      label: t.read,
      kind: state.flightReport ? "quiet" : "primary",
      why: reportReading ? t.reading : "",
      press: () => actions.readReport(),
    })}
  </div>`;
}
