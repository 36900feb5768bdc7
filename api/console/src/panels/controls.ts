/** Buttons and fields, so that all have the same look, accessible text and refusals. */

import { html, nothing, type TemplateResult } from "lit-html";
import { texts } from "../texts";
import type { State } from "../state";
import { parsed } from "./format";
import { icon, type IconName } from "./icons";
import type { PanelActions } from "./actions";
import { focused } from "./place";

export interface Button {
  id: string; // data-testid
  label: string;
  press: () => void;
  why?: string; // it may not be pressed, and why
  icon?: IconName;
  kind?: "normal" | "primary" | "danger" | "quiet";
  name?: string; // for a screen reader, where the label alone is not enough
  describedBy?: string; // id of the element that describes it
  pressed?: boolean;
  expanded?: boolean;
  iconOnly?: boolean;
  focus?: boolean; // when it appears
}

/** A disabled button stays in the tab order, so that the keyboard reaches its reason. */
export function button(actions: PanelActions, b: Button): TemplateResult {
  const why = b.why ?? "";
  return html`<button
    type="button"
    class="button ${b.kind ?? "normal"} ${b.iconOnly ? "icon-only" : ""}"
    data-testid=${b.id}
    aria-label=${b.name ?? (b.iconOnly ? b.label : nothing)}
    aria-disabled=${why === "" ? nothing : "true"}
    aria-describedby=${b.describedBy ?? nothing}
    aria-pressed=${b.pressed === undefined ? nothing : String(b.pressed)}
    aria-expanded=${b.expanded === undefined ? nothing : String(b.expanded)}
    title=${why || b.name || (b.iconOnly ? b.label : "") || nothing}
    ${focused(b.focus ?? false)}
    @click=${() => (why === "" ? b.press() : actions.refuse(b.name ?? b.label, why))}
  >
    ${b.icon ? icon(b.icon) : nothing}${b.iconOnly ? nothing : html`<span>${b.label}</span>`}
  </button>`;
}

/** A button that takes a second press, and names its effect before. `about` distinguishes it from others. */
export function twice(state: State, actions: PanelActions, b: Omit<Button, "kind"> & { sure: string; about: string }): TemplateResult {
  const isSure = state.panels.sure === b.about;
  const press = (): void => {
    actions.set({ sure: isSure ? "" : b.about });
    if (isSure) b.press();
  };
  return button(actions, { ...b, label: isSure ? b.sure : b.label, kind: isSure ? "danger" : "normal", press });
}

export interface NumberField {
  field: string; // draft, and data-testid
  label: string;
  unit: string;
  value: string; // as the service reports it
  now?: string; // where it is on its way there
}

/** Typed text stays until it is sent or undone, whatever the service reports meanwhile. */
export function numberField(state: State, actions: PanelActions, f: NumberField): TemplateResult {
  const draft = state.panels.drafts[f.field];
  const wrong = draft !== undefined && parsed(draft) === null;
  return html`<label class="field ${draft === undefined ? "" : "changed"} ${wrong ? "wrong" : ""}">
    <span class="field-name">${f.label}${f.now ? html`<small>${texts.shape.now} ${f.now}</small>` : nothing}</span>
    <span class="field-box">
      <input
        type="text"
        inputmode="decimal"
        autocomplete="off"
        spellcheck="false"
        data-testid=${f.field}
        aria-invalid=${wrong ? "true" : "false"}
        .value=${draft ?? f.value}
        @input=${(event: Event) => actions.draft(f.field, (event.target as HTMLInputElement).value)}
      />
      <span class="unit">${f.unit}</span>
    </span>
    ${wrong ? html`<span class="field-problem">${texts.shape.badNumber}</span>` : nothing}
  </label>`;
}

export function textField(
  state: State,
  actions: PanelActions,
  f: { field: string; label: string; placeholder?: string; problem?: string; focus?: boolean; secret?: boolean },
): TemplateResult {
  return html`<label class="field wide ${f.problem ? "wrong" : ""}">
    <span class="field-name">${f.label}</span>
    <span class="field-box">
      <input
        type=${f.secret ? "password" : "text"}
        autocomplete="off"
        spellcheck="false"
        data-testid=${f.field}
        ${focused(f.focus ?? false)}
        placeholder=${f.placeholder ?? nothing}
        aria-invalid=${f.problem ? "true" : "false"}
        .value=${state.panels.drafts[f.field] ?? ""}
        @input=${(event: Event) => actions.draft(f.field, (event.target as HTMLInputElement).value)}
      />
    </span>
    ${f.problem ? html`<span class="field-problem">${f.problem}</span>` : nothing}
  </label>`;
}

export interface Choice<T extends string> {
  value: T;
  label: string;
}

/** One of a few, all of them to be seen. */
export function choices<T extends string>(
  id: string,
  label: string,
  all: readonly Choice<T>[],
  chosen: T,
  choose: (value: T) => void,
): TemplateResult {
  return html`<div class="choices" role="group" aria-label=${label}>
    ${all.map(
      (each) => html`<button
        type="button"
        class="choice"
        data-testid="${id}-${each.value}"
        aria-pressed=${String(each.value === chosen)}
        @click=${() => choose(each.value)}
      >
        ${each.label}
      </button>`,
    )}
  </div>`;
}
