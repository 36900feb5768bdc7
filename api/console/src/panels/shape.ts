/** Formation, orbit, target, yaw: as they are, and as they shall be. What is typed is sent group by group. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { State } from "../state";
import type { Group } from "./state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button, choices, numberField, type NumberField } from "./controls";
import { fixed, parsed, withUnit } from "./format";
import { whyNot, whyNotShape } from "./rights";

export type { Group } from "./state";

const t = texts.shape;

/** The numbers of a group as typed, those left alone left out; null when one of them is none. Pure. */
export function typedNumbers(drafts: Readonly<Record<string, string>>, group: string): Record<string, number> | null {
  const numbers: Record<string, number> = {};
  for (const [field, text] of Object.entries(drafts)) {
    const [of, name] = field.split(":");
    if (of !== group || name === undefined) continue;
    const value = parsed(text);
    if (value === null) return null;
    numbers[name] = value;
  }
  return numbers;
}

export function whyNotGroup(state: State, group: Group): string {
  return group === "yaw" ? whyNot(state, "yaw") : whyNotShape(state, group);
}

function hasDrafts(state: State, group: Group): boolean {
  return Object.keys(state.panels.drafts).some((field) => field.startsWith(`${group}:`));
}

function section(
  state: State,
  actions: PanelActions,
  group: Group,
  title: string,
  fields: readonly NumberField[],
  more: TemplateResult | typeof nothing = nothing,
): TemplateResult {
  const changed = hasDrafts(state, group);
  const why = whyNotGroup(state, group);
  const wrong = typedNumbers(state.panels.drafts, group) === null ? t.badNumber : "";
  return html`<form
    class="group"
    aria-label=${title}
    @submit=${(event: Event) => {
      event.preventDefault();
      actions.apply(group);
    }}
  >
    <h3>${title}</h3>
    <div class="fields">${fields.map((each) => numberField(state, actions, each))}</div>
    ${more}
    <div class="buttons" ?hidden=${!changed}>
      <button
        type="submit"
        class="button primary"
        data-testid="${group}-apply"
        aria-disabled=${why || wrong ? "true" : nothing}
        title=${why || wrong || nothing}
      >
        <span>${texts.shell.apply}</span>
      </button>
      ${button(actions, { id: `${group}-undo`, label: texts.shell.undo, kind: "quiet", press: () => actions.undo(`${group}:`) })}
    </div>
  </form>`;
}

export function shape(state: State, actions: PanelActions): TemplateResult {
  const { status, frame } = state;
  if (!status) return html`<p class="empty">${t.none}</p>`;
  const { formation, orbit, target, yaw } = status;
  const led = whyNotShape(state, "formation");
  const moving = (desired: number, now: number | null | undefined): string =>
    now !== null && now !== undefined && Math.abs(now - desired) > 0.05 ? withUnit(now, "m") : "";
  const target_m = frame?.target_m ?? [target.x_m ?? NaN, target.y_m ?? NaN];
  const pick = <T extends string>(id: string, label: string, all: readonly (readonly [T, string])[], now: T, send: (value: T) => void): TemplateResult =>
    html`<div class="rowed">
      <span>${label}</span>
      ${choices(id, label, all.map(([value, words]) => ({ value, label: words })), now, (value) => {
        const denied = whyNotGroup(state, id === "yaw-policy" ? "yaw" : "orbit");
        if (denied === "") send(value);
        else actions.refuse(label, denied);
      })}
    </div>`;
  return html`<div class="shape" data-testid="shape">
    ${led ? html`<p class="hint" data-testid="shape-why">${led}</p>` : nothing}
    ${section(state, actions, "formation", t.sphere, [
      { field: "formation:radius_m", label: t.radius, unit: "m", value: fixed(formation.radius_m), now: moving(formation.radius_m, frame?.radius_m ?? formation.radius_now_m) },
      { field: "formation:height_m", label: t.height, unit: "m", value: fixed(formation.height_m), now: moving(formation.height_m, frame?.center_m?.[2] ?? formation.height_now_m) },
    ], html`<p class="hint" data-testid="law">${t.law}: ${formation.law}</p>`)}
    ${section(state, actions, "target", t.target, [
      { field: "target:x_m", label: "x", unit: "m", value: fixed(target_m[0]) },
      { field: "target:y_m", label: "y", unit: "m", value: fixed(target_m[1]) },
      { field: "target:velocity_x_m_s", label: t.velocityX, unit: "m/s", value: fixed(target.velocity_x_m_s, 2) },
      { field: "target:velocity_y_m_s", label: t.velocityY, unit: "m/s", value: fixed(target.velocity_y_m_s, 2) },
    ])}
    ${section(
      state,
      actions,
      "orbit",
      t.orbit,
      [
        { field: "orbit:radius_m", label: t.orbitRadius, unit: "m", value: fixed(orbit.radius_m) },
        { field: "orbit:speed_m_s", label: t.orbitSpeed, unit: "m/s", value: fixed(orbit.speed_m_s, 2) },
      ],
      pick("orbit-direction", t.direction, [["counterclockwise", t.counterclockwise], ["clockwise", t.clockwise]] as const, orbit.direction, (value) =>
        actions.changeOrbit({ direction: value }),
      ),
    )}
    ${section(
      state,
      actions,
      "yaw",
      t.yaw,
      [{ field: "yaw:heading_deg", label: t.heading, unit: "°", value: fixed(yaw.heading_deg, 0) }],
      pick("yaw-policy", t.policy, [["held", t.policies.held], ["fixed", t.policies.fixed], ["target", t.policies.target]] as const, yaw.policy, (value) =>
        actions.changeYaw({ policy: value }),
      ),
    )}
  </div>`;
}
