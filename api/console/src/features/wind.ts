/** The wind that the vehicles measure, at a glance while they fly: how much, from where, and what is allowed. */

import { html, nothing, type TemplateResult } from "lit-html";
import { icon } from "../panels/icons";
import type { Features, State } from "../state";
import type { Feature } from "./feature";

type Wind = NonNullable<Features["wind"]>;

export const t = {
  title: "Wind",
  hint: "Measured from how the vehicles tilt; with gusts, two standard deviations more",
  measured: (speed: number, from: number, gusts: number): string =>
    `${speed.toFixed(1)} m/s from ${String(Math.round(from) % 360).padStart(3, "0")}°, gusts to ${gusts.toFixed(1)}`,
  unknown: "not known",
  allowed: (allowed: number): string => `allowed ${allowed}`,
};

/** Whether it is, or surely is, more than allowed. */
const isOver = ({ with_gusts_m_s, at_least_m_s, allowed_m_s }: Wind): boolean =>
  Math.max(with_gusts_m_s ?? 0, at_least_m_s ?? 0) > allowed_m_s;

function words({ speed_m_s, from_deg, with_gusts_m_s }: Wind): string {
  if (speed_m_s === null || from_deg === null || with_gusts_m_s === null) return t.unknown;
  return t.measured(speed_m_s, from_deg, with_gusts_m_s);
}

function glance({ features, status }: State): TemplateResult | null {
  const wind = (features ?? status?.features)?.wind;
  if (!wind?.vehicles || !status || status.replay) return null;
  const over = isOver(wind);
  return html`<dl class="energy glance" aria-label=${t.title} data-testid="wind">
    <div class=${over ? "stopped" : ""} title=${wind.why_unknown || t.hint}>
      <dt>${t.title}</dt>
      <dd class="value" data-testid="wind-measured">
        ${over ? icon("warning") : nothing}${words(wind)}, ${t.allowed(wind.allowed_m_s)}
      </dd>
    </div>
  </dl>`;
}

export const wind: Feature = { glance, isRead: ({ features, counts }) => features.wind !== null && counts.airborne > 0 };
