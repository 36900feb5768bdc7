/** Show files: upload, check, what the check found, select. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { ShowCheck, State, StoredShow } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button } from "./controls";
import { fixed, minutes, percent, withUnit } from "./format";
import { icon } from "./icons";
import { placingPanel, whyNotPlacing } from "../placing/panel";
import { whyNot, whyNotOnGround } from "./rights";

const t = texts.shows;

type Figures = NonNullable<ShowCheck["figures"]>;

function figures(found: Figures): TemplateResult {
  const f = t.figures;
  const pair = (name: string, value: string): TemplateResult => html`<div><dt>${name}</dt><dd>${value}</dd></div>`;
  return html`<dl class="facts" data-testid="show-figures">
      ${pair(f.vehicles, String(found.vehicles))} ${pair(f.show, minutes(found.show_s))}
      ${pair(f.home, minutes(found.home_s))}
      ${pair(f.separation, `${withUnit(found.separation_min_m, "m", 2)} (${texts.bar.floor} ${withUnit(found.floor_m, "m")}), ${found.separation_min_at}`)}
      ${pair(f.belowFloor, String(found.pairs_below_floor))} ${pair(f.speed, withUnit(found.speed_max_m_s, "m/s"))}
      ${pair(f.fence, f.margins(withUnit(found.fence_distance_margin_m, "m"), withUnit(found.fence_height_margin_m, "m")))}
      ${pair(f.battery, percent(found.battery_need))} ${pair(f.columns, String(found.vertical_overlaps))}
    </dl>
    <table class="plain-table">
      <thead>
        <tr>
          <th scope="col">${t.cueAt}</th>
          <th scope="col">${t.cue}</th>
          <th scope="col">${t.cueShape}</th>
          <th scope="col">${t.cueNearest}</th>
        </tr>
      </thead>
      <tbody>
        ${found.cues.map(
          (cue) => html`<tr>
            <td class="number">${minutes(cue.at_s)}</td>
            <td>${cue.cue}</td>
            <td class="number">${fixed(cue.radius_m)} × ${fixed(cue.height_m)}</td>
            <td class="number">${fixed(cue.separation_m)}</td>
          </tr>`,
        )}
      </tbody>
    </table>`;
}

function problems(check: ShowCheck): TemplateResult | typeof nothing {
  if (check.problems.length === 0) return nothing;
  return html`<ul class="plain problems" data-testid="show-problems">
    ${check.problems.map((each) => html`<li><b>${t.line(each.line, each.cue)}</b> ${each.text}</li>`)}
  </ul>`;
}

/** Why the service would not select this show as it was checked last; "" where it has not refused it. Pure. */
export function refusal(state: State, name: string): string {
  const refused = state.panels.showsRefused[name];
  return refused !== undefined && state.panels.checks[name]?.hash === refused.hash ? refused.problem : "";
}

/** The button that was pressed says that the page reads a drawing. */
function labelOf({ panels: { reading } }: State): (id: string, label: string) => string {
  return (id, label) => (reading === id ? t.reading : label);
}

/** Whether the file has changed since the service selected it: that is what would start. Pure. */
export function isOutdated({ panels, status }: State, { name, hash }: Pick<StoredShow, "name" | "hash">): boolean {
  const selected = status?.show.selected;
  const now = panels.checks[name]?.hash ?? hash;
  return selected?.name === name && now !== null && now !== selected.hash;
}

function verdict(check: ShowCheck | undefined, refused: string): TemplateResult {
  if (!check) return html`<span class="verdict">${icon("question")}${t.unchecked}</span>`;
  if (check.state !== "done") {
    return html`<span class="verdict ${check.state === "failed" ? "bad" : ""}">
      ${icon(check.state === "failed" ? "cross" : "events")}${t.states[check.state]} ${check.reason}
    </span>`;
  }
  if (check.good && refused) return html`<span class="verdict bad">${icon("cross")}${t.notSelectable}</span>`;
  return check.good
    ? html`<span class="verdict good">${icon("check")}${t.good}</span>`
    : html`<span class="verdict bad">${icon("cross")}${t.bad(check.problems.length)}</span>`;
}

function one(state: State, actions: PanelActions, file: StoredShow): TemplateResult {
  const { checks, openShow, sure } = state.panels;
  const label = labelOf(state);
  const check = checks[file.name];
  const selected = state.status?.show.selected?.name === file.name;
  const why = whyNot(state, "shows");
  const whyNotNow = why || whyNotOnGround(state);
  const outdated = isOutdated(state, file);
  const refused = selected && !outdated ? "" : refusal(state, file.name);
  const open = openShow === file.name;
  const removing = sure === `show:${file.name}`;
  const named = (label: string): string => `${label} ${file.name}`;
  return html`<li class="card ${selected ? "selected" : ""}" data-testid="show-${file.name}">
    <header>
      ${icon("show")}
      <h3>${file.name}</h3>
      ${outdated
        ? html`<span class="tag bad" data-testid="show-outdated">${icon("warning")}${t.outdated}</span>`
        : selected
          ? html`<span class="tag accent">${icon("check")}${t.selected}</span>`
          : nothing}
      <span class="spring"></span>
      <span data-testid="show-verdict-${file.name}">${verdict(check, refused)}</span>
    </header>
    <div class="buttons">
      ${button(actions, { id: `show-check-${file.name}`, label: t.check, name: named(t.check), why, press: () => actions.checkShow(file.name) })}
      ${selected
        ? button(actions, { id: `show-deselect-${file.name}`, label: t.deselect, name: named(t.deselect), why: whyNotNow, press: () => actions.deselectShow() })
        : nothing}
      ${selected && !outdated
        ? nothing
        : button(actions, {
            id: `show-select-${file.name}`,
            label: selected ? t.selectAgain : t.select,
            name: named(selected ? t.selectAgain : t.select),
            kind: check?.good && !refused ? "primary" : "normal",
            why: whyNotNow || (check?.good && check.hash ? "" : t.unchecked),
            press: () => actions.selectShow(file.name, check?.hash ?? ""),
          })}
      ${file.drawing
        ? button(actions, {
            id: `show-preview-${file.name}`,
            label: label(`show-preview-${file.name}`, t.preview),
            name: named(t.preview),
            why: whyNotOnGround(state),
            press: () => actions.previewShow(file.name),
          })
        : nothing}
      ${file.drawing
        ? button(actions, {
            id: `show-place-${file.name}`,
            label: label(`show-place-${file.name}`, t.place),
            name: named(t.place),
            why: whyNotPlacing(state),
            press: () => actions.placeShow(file.name),
          })
        : nothing}
      ${check?.state === "done"
        ? button(actions, {
            id: `show-open-${file.name}`,
            label: t.open,
            name: named(t.open),
            kind: "quiet",
            expanded: open,
            press: () => actions.set({ openShow: open ? null : file.name }),
          })
        : nothing}
      ${button(actions, {
        id: `show-remove-${file.name}`,
        label: removing ? t.sure : t.remove,
        name: named(removing ? t.sure : t.remove),
        kind: removing ? "danger" : "quiet",
        why,
        press: () => (removing ? actions.removeShow(file.name) : actions.set({ sure: `show:${file.name}` })),
      })}
    </div>
    ${refused ? html`<p class="problem" data-testid="show-refused-${file.name}">${t.refusedBecause(refused)}</p>` : nothing}
    ${check?.state === "done" ? problems(check) : nothing} ${open && check?.figures ? figures(check.figures) : nothing}
  </li>`;
}

export function shows(state: State, actions: PanelActions): TemplateResult {
  const all = state.panels.shows ?? [];
  const why = whyNot(state, "shows");
  const label = labelOf(state);
  const noUploads = state.status?.shows_refused ?? "";
  const chosen = (event: Event): void => {
    const input = event.target as HTMLInputElement;
    const file = input.files?.[0];
    if (file && state.panels.reading === "") actions.upload(file);
    input.value = "";
  };
  /** Without fresh data for a moment a disabled one would lose the focus. */
  const asked = (event: Event): void => {
    if (why === "") return;
    event.preventDefault();
    actions.refuse(t.upload, why);
  };
  return html`<div class="shows" data-testid="shows">
    ${state.panels.showsProblem ? html`<p class="problem" role="alert" data-testid="shows-problem">${state.panels.showsProblem}</p>` : nothing}
    ${placingPanel(state, actions)}
    ${all.length
      ? html`<ul class="cards">
          ${all.map((file) => one(state, actions, file))}
        </ul>`
      : html`<p class="empty">${t.none}</p>`}
    ${noUploads
      ? html`<p class="hint" data-testid="show-no-upload">${t.noUploads(noUploads)}</p>`
      : html`<label class="button upload ${why ? "denied" : ""}" title=${why || nothing}>
      ${icon("up")}<span>${label("show-upload", t.upload)}</span>
      <input type="file" accept=".yaml,.yml,.skyc,.zip,.csv" data-testid="show-upload" aria-label=${t.upload} aria-disabled=${why === "" ? nothing : "true"} @click=${asked} @change=${chosen} />
        </label>`}
    ${why && !noUploads ? html`<p class="hint">${why}</p>` : nothing}
  </div>`;
}
