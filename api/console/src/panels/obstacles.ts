/** Obstacles as a list: add, change, remove. The scene shows what is edited as a ghost, and its handles change it; see obstacle.ts. */

import { html, nothing, type TemplateResult } from "lit-html";
import { fieldOf, NEW, NEW_OBSTACLE, type Box } from "../obstacle";
import type { Obstacle, State } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button, numberField, textField } from "./controls";
import { fixed, withUnit } from "./format";
import { icon } from "./icons";
import { whyNot } from "./rights";

const t = texts.obstacles;

const FIELDS: readonly (readonly [keyof Box, string])[] = [
  ["x_m", t.x],
  ["y_m", t.y],
  ["half_length_x_m", t.halfX],
  ["half_length_y_m", t.halfY],
  ["height_m", t.height],
];

function form(state: State, actions: PanelActions, known: Obstacle | null): TemplateResult {
  const values = known ?? NEW_OBSTACLE;
  return html`<form
    class="group inline-form"
    aria-label=${known ? t.of(known.id) : t.add}
    @submit=${(event: Event) => {
      event.preventDefault();
      actions.saveObstacle();
    }}
  >
    ${known ? nothing : textField(state, actions, { field: "obstacle-id", label: t.id, placeholder: "tower", focus: true })}
    <div class="fields">
      ${FIELDS.map(([name, label]) => numberField(state, actions, { field: fieldOf(name), label, unit: "m", value: fixed(values[name]) }))}
    </div>
    <div class="buttons">
      <button type="submit" class="button primary" data-testid="obstacle-save"><span>${t.save}</span></button>
      ${button(actions, { id: "obstacle-cancel", label: texts.shell.cancel, kind: "quiet", press: () => actions.edit(null) })}
    </div>
  </form>`;
}

function one(state: State, actions: PanelActions, box: Obstacle): TemplateResult {
  const { editing, sure } = state.panels;
  const why = whyNot(state, "obstacle");
  const speed = Math.hypot(box.velocity_x_m_s, box.velocity_y_m_s);
  const removing = sure === `obstacle:${box.id}`;
  return html`<li class="card" data-testid="obstacle-${box.id}">
    <header>
      ${icon("obstacle")}
      <h3>${box.id}</h3>
      <span class="value">x ${fixed(box.x_m)}, y ${fixed(box.y_m)} m</span>
    </header>
    <p class="value dim">
      ${t.size(withUnit(2 * box.half_length_x_m, "m"), withUnit(2 * box.half_length_y_m, "m"), withUnit(box.height_m, "m"))}${speed > 0
        ? `, ${t.moves(withUnit(speed, "m/s"))}`
        : ""}
    </p>
    ${editing === box.id
      ? form(state, actions, box)
      : html`<div class="buttons">
          ${button(actions, { id: `obstacle-change-${box.id}`, label: t.change, name: `${t.change} ${box.id}`, why, press: () => actions.edit(box.id) })}
          ${button(actions, {
            id: `obstacle-remove-${box.id}`,
            label: removing ? t.sure : t.remove,
            name: `${removing ? t.sure : t.remove}: ${box.id}`,
            kind: removing ? "danger" : "quiet",
            why,
            press: () => (removing ? actions.removeObstacle(box.id) : actions.set({ sure: `obstacle:${box.id}` })),
          })}
        </div>`}
  </li>`;
}

export function obstacles(state: State, actions: PanelActions): TemplateResult {
  const all = state.status?.obstacles ?? [];
  const { editing } = state.panels;
  return html`<div class="obstacles" data-testid="obstacles">
    ${all.length ? html`<ul class="cards">${all.map((box) => one(state, actions, box))}</ul>` : html`<p class="empty">${t.none}</p>`}
    ${editing === NEW
      ? form(state, actions, null)
      : button(actions, { id: "obstacle-add", label: t.add, icon: "obstacle", why: whyNot(state, "obstacle"), press: () => actions.edit(NEW) })}
    ${editing === NEW ? html`<p class="dim">${t.place}</p>` : nothing} ${all.length || editing === NEW ? html`<p class="dim">${t.drag}</p>` : nothing}
  </div>`;
}
