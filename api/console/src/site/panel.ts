/** The site in words: its areas, and while it is edited their corners and heights. The scene has the same as handles. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PanelActions } from "../panels/actions";
import { button } from "../panels/controls";
import { icon } from "../panels/icons";
import { whyNotOnGround } from "../panels/ground";
import type { Site, State } from "../state";
import { AREA_KINDS, type Area, type AreaKind, type Corner } from "./area";
import { areasOf, CORNERS_MAX, CORNERS_MIN, isChanged, whyNotAdded, type SiteEdit, type Step } from "./model";
import { KINDS, t } from "./texts";

const STEP_M = 1;
const FAR_STEP_M = 10;

/** Along x, along y. */
const ARROWS: Readonly<Record<string, readonly [number, number]>> = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowRight: [0, 1], ArrowLeft: [0, -1] };

export function whyNotSave(state: State, why: string): string {
  const { edit } = state.site;
  if (why !== "") return why;
  if (edit === null || !isChanged(edit)) return t.unchanged;
  return edit.isSaving ? t.saving : whyNotOnGround(state);
}

function shown(area: Area, k: number): TemplateResult {
  return html`<li class="card" data-testid="site-area-${k}">
    <header><h3>${t.named(area.kind, area.name)}</h3></header>
    <p class="value dim">${t.corners(area.corners.length)}, ${t.heights(area.height_min_m, area.height_max_m)}</p>
  </li>`;
}

interface Numbers {
  id: string;
  label: string;
  value: number | null;
  set: (value: number | null) => void;
}

function field(f: Numbers): TemplateResult {
  const changed = (event: Event): void => {
    const text = (event.target as HTMLInputElement).value;
    const value = Number.parseFloat(text);
    if (text === "" || Number.isFinite(value)) f.set(text === "" ? null : value);
  };
  return html`<label class="field">
    <span class="field-name">${f.label}</span>
    <span class="field-box">
      <input type="number" step="0.1" autocomplete="off" data-testid=${f.id} placeholder=${f.value === null ? t.noLimit : nothing}
        .value=${f.value === null ? "" : String(f.value)} @change=${changed} />
      <span class="unit">m</span>
    </span>
  </label>`;
}

const step = (actions: PanelActions, what: Step, gesture = ""): void => actions.dispatch({ kind: "site-step", step: what, gesture });

/** Once it is drawn. */
function focusCorner(actions: PanelActions): void {
  requestAnimationFrame(() =>
    requestAnimationFrame(() => document.querySelector<HTMLElement>(`[data-testid="site-corner-${actions.now().site.edit?.corner}"]`)?.focus()),
  );
}

function onCornerKey(event: KeyboardEvent, actions: PanelActions, edit: SiteEdit, area: number, corner: number): void {
  const at = edit.areas[area]?.corners[corner];
  const way = ARROWS[event.key];
  if (at === undefined || event.ctrlKey || event.altKey || event.metaKey) return;
  if (way !== undefined) {
    const by_m = event.shiftKey ? FAR_STEP_M : STEP_M;
    step(actions, { what: "move", area, corner, x_m: at.x_m + by_m * way[0], y_m: at.y_m + by_m * way[1] }, event.repeat ? `key:${area}:${corner}` : "");
  } else if (event.key === "Insert") {
    step(actions, { what: "add", area, corner });
    focusCorner(actions);
  } else if (event.key === "Delete") {
    remove(actions, edit, area, corner);
    focusCorner(actions);
  } else {
    return;
  }
  event.preventDefault();
}

function remove(actions: PanelActions, edit: SiteEdit, area: number, corner: number): void {
  if ((edit.areas[area]?.corners.length ?? 0) <= CORNERS_MIN) return actions.refuse(t.remove, t.fewest);
  step(actions, { what: "remove", area, corner });
}

function cornerRow(actions: PanelActions, edit: SiteEdit, at: Corner, k: number): TemplateResult {
  const wrong = edit.problems.some((each) => each.area === edit.area && each.corners.includes(k));
  const now = (): SiteEdit => actions.now().site.edit ?? edit; // keys come faster than views
  return html`<li>
    <button
      type="button"
      class="site-corner ${wrong ? "wrong" : ""}"
      data-testid="site-corner-${k}"
      aria-pressed=${String(k === edit.corner)}
      aria-describedby=${wrong ? "site-problems" : nothing}
      @click=${() => actions.dispatch({ kind: "site-choose", area: edit.area, corner: k })}
      @focus=${() => k !== now().corner && actions.dispatch({ kind: "site-choose", area: edit.area, corner: k })}
      @keydown=${(event: KeyboardEvent) => onCornerKey(event, actions, now(), edit.area, k)}
    >
      <span>${wrong ? icon("warning") : nothing}${t.corner(k + 1)}</span><span class="value">${t.at(at.x_m, at.y_m)}</span>
    </button>
  </li>`;
}

function chosenArea(actions: PanelActions, edit: SiteEdit): TemplateResult {
  const { area: at, corner } = edit;
  const area = edit.areas[at]!;
  const here = area.corners[corner]!;
  const move = (change: Partial<Corner>): void => {
    const { x_m, y_m } = actions.now().site.edit?.areas[at]?.corners[corner] ?? here; // the other number may just have been typed
    step(actions, { what: "move", area: at, corner, x_m, y_m, ...change });
  };
  const height = (key: "height_min_m" | "height_max_m") => (value_m: number | null) => step(actions, { what: "height", area: at, key, value_m });
  const name = t.named(area.kind, area.name);
  return html`<h3 data-testid="site-area">${name}</h3>
    <div class="fields">
      ${field({ id: "site-least", label: t.least, value: area.height_min_m, set: height("height_min_m") })}
      ${field({ id: "site-greatest", label: t.greatest, value: area.height_max_m, set: height("height_max_m") })}
    </div>
    <div class="buttons">
      ${button(actions, {
        id: "site-area-remove",
        label: t.removeArea,
        name: t.removed(name),
        why: edit.areas.length === 1 ? t.lastArea : "",
        press: () => step(actions, { what: "remove-area", area: at }),
      })}
    </div>
    <h3>${t.list}</h3>
    <ol class="site-corners" data-testid="site-corners" aria-label=${t.list}>
      ${area.corners.map((each, k) => cornerRow(actions, edit, each, k))}
    </ol>
    <div class="fields">
      ${field({ id: "site-x", label: `${t.corner(corner + 1)}: ${t.x}`, value: here.x_m, set: (x_m) => x_m !== null && move({ x_m }) })}
      ${field({ id: "site-y", label: t.y, value: here.y_m, set: (y_m) => y_m !== null && move({ y_m }) })}
    </div>
    <div class="buttons">
      ${button(actions, {
        id: "site-add",
        label: t.add,
        why: area.corners.length >= CORNERS_MAX ? t.most : "",
        press: () => step(actions, { what: "add", area: at, corner }),
      })}
      ${button(actions, {
        id: "site-remove",
        label: t.remove,
        why: area.corners.length <= CORNERS_MIN ? t.fewest : "",
        press: () => remove(actions, edit, at, corner),
      })}
    </div>`;
}

/** It is chosen then, and in the picture. */
function addArea(actions: PanelActions, kind: AreaKind): void {
  step(actions, { what: "add-area", kind });
  actions.view({ fits: actions.now().view.fits + 1 });
  focusCorner(actions);
}

function newAreas(actions: PanelActions, edit: SiteEdit): TemplateResult {
  return html`<h3 id="site-kinds">${t.addArea}</h3>
    <div class="buttons" role="group" aria-labelledby="site-kinds">
      ${AREA_KINDS.map((kind) => {
        const why = whyNotAdded(edit.areas, kind);
        return button(actions, {
          id: `site-add-${kind}`,
          label: KINDS[kind],
          name: t.added(kind),
          why: why === null ? "" : t.notAdded[why](kind),
          press: () => addArea(actions, kind),
        });
      })}
    </div>`;
}

function onPanelKey(event: KeyboardEvent, actions: PanelActions): void {
  const key = event.key.toLowerCase();
  const isTyping = event.target instanceof Element && event.target.matches("input");
  if (isTyping || !(event.ctrlKey || event.metaKey) || !["z", "y"].includes(key)) return;
  actions.dispatch({ kind: "site-edit", how: key === "y" || event.shiftKey ? "redo" : "undo" });
  event.preventDefault();
}

function editor(state: State, actions: PanelActions, edit: SiteEdit, why: string): TemplateResult {
  const isOther = state.site.stored !== null && state.site.stored.version !== edit.version;
  const how = (what: "discard" | "undo" | "redo") => () => actions.dispatch({ kind: "site-edit", how: what });
  return html`<section class="site-editor" data-testid="site-editor" @keydown=${(event: KeyboardEvent) => onPanelKey(event, actions)}>
    <p class="hint">${t.how}</p>
    ${isOther ? html`<p class="problem" role="alert">${t.another}</p>` : nothing}
    ${edit.problems.length === 0
      ? nothing
      : html`<div class="problem" role="alert" id="site-problems" data-testid="site-problems">
          <p>${icon("warning")} ${t.refused}</p>
          <ul>${edit.problems.map((each) => html`<li>${each.text}</li>`)}</ul>
        </div>`}
    <div class="buttons">
      ${button(actions, { id: "site-save", label: edit.isSaving ? t.saving : t.save, kind: "primary", why: whyNotSave(state, why), press: () => actions.saveSite() })}
      ${button(actions, { id: "site-discard", label: t.discard, kind: "quiet", press: how("discard") })}
      ${button(actions, { id: "site-undo", label: t.undo, why: edit.past.length === 0 ? t.nothingToUndo : "", press: how("undo") })}
      ${button(actions, { id: "site-redo", label: t.redo, why: edit.future.length === 0 ? t.nothingToRedo : "", press: how("redo") })}
    </div>
    <h3>${t.areas}</h3>
    <div class="choices site-areas" role="group" aria-label=${t.areas}>
      ${edit.areas.map(
        (each, k) => html`<button
          type="button"
          class="choice"
          data-testid="site-choose-${k}"
          aria-pressed=${String(k === edit.area)}
          @click=${() => actions.dispatch({ kind: "site-choose", area: k, corner: 0 })}
        >
          ${edit.problems.some((problem) => problem.area === k) ? icon("warning") : nothing}${t.named(each.kind, each.name)}
        </button>`,
      )}
    </div>
    ${newAreas(actions, edit)} ${chosenArea(actions, edit)}
  </section>`;
}

export function sitePanel(state: State, actions: PanelActions, why: string): TemplateResult {
  const { stored, edit } = state.site;
  const content = edit !== null ? editor(state, actions, edit, why) : stored === null ? html`<p class="empty">${t.unread}</p>` : overview(state, actions, stored, why);
  return html`<div class="site" data-testid="site">${content}</div>`; // it stays, and with it the focus
}

function overview(state: State, actions: PanelActions, stored: Site, why: string): TemplateResult {
  const press = (): void => {
    actions.dispatch({ kind: "site-edit", how: "begin" });
    actions.view({ fits: actions.now().view.fits + 1 });
  };
  return html`<p><strong>${stored.name}</strong> <span class="dim">${stored.file}, <span class="value" title=${stored.hash}>${stored.hash.slice(0, 12)}</span></span></p>
    <p class=${stored.pending === "" ? "hint" : "problem"} data-testid="site-state">${stored.pending === "" ? t.inForce : stored.pending}</p>
    ${button(actions, { id: "site-edit", label: t.edit, why: why || whyNotOnGround(state), press })}
    <ul class="cards">${areasOf(stored).map(shown)}</ul>`;
}
