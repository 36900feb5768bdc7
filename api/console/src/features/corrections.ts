/** Corrections for RTK at a glance: age, receivers that use them, base, messages. */

import { html, nothing, type TemplateResult } from "lit-html";
import { seconds, withUnit } from "../panels/format";
import { icon } from "../panels/icons";
import type { Features, State } from "../state";
import type { Feature } from "./feature";

type Corrections = NonNullable<Features["corrections"]>;

export const t = {
  title: "Corrections for RTK",
  age: "RTK",
  ageHint: (source: string): string => `Age of the newest correction; source: ${source}`,
  stopped: "stopped",
  none: "none yet",
  fixes: (fixed: number, float: number, all: number): string => `${fixed} fixed, ${float} float of ${all}`,
  fixesName: "Fix",
  fixesHint: "Vehicles on the ground or in the air whose receivers report RTK fixed or float",
  base: "Base",
  baseHint: "Place of the base as it reports it: compare it with where it stands",
  baseAt: (latitude: string, longitude: string, height: string): string => `${latitude}, ${longitude}, ${height}`,
  messages: "Messages",
  messagesHint: (sent: number, dropped: number): string => `That arrived from the base; ${sent} sent over the links, ${dropped} dropped`,
  count: (messages: number, dropped: number): string => (dropped > 0 ? `${messages}, ${dropped} dropped` : String(messages)),
};

/** GPS_FIX_TYPE. */
const [FLOAT, FIXED] = [5, 6];

function age({ age_s, problem }: Corrections): string {
  if (problem !== "") return t.stopped;
  return age_s === null ? t.none : seconds(age_s);
}

function base({ base_latitude_deg, base_longitude_deg, base_height_m }: Corrections): string | null {
  if (base_latitude_deg === null || base_longitude_deg === null) return null;
  return t.baseAt(base_latitude_deg.toFixed(6), base_longitude_deg.toFixed(6), withUnit(base_height_m, "m"));
}

function glance({ features, status }: State): TemplateResult | null {
  const found = (features ?? status?.features)?.corrections;
  if (!found || !status || status.replay) return null;
  const fixes = (type: number): number => status.vehicles.filter((each) => each.fix_type === type).length;
  const at = base(found);
  const stopped = found.problem !== "";
  return html`<dl class="energy glance" aria-label=${t.title} data-testid="corrections">
    <div class=${stopped ? "stopped" : ""} title=${stopped ? found.problem : t.ageHint(found.source)}>
      <dt>${t.age}</dt>
      <dd class="value" data-testid="corrections-age">${stopped ? icon("warning") : nothing}${age(found)}</dd>
    </div>
    <div title=${t.fixesHint}>
      <dt>${t.fixesName}</dt>
      <dd class="value" data-testid="corrections-fixes">${t.fixes(fixes(FIXED), fixes(FLOAT), status.vehicles.length)}</dd>
    </div>
    ${at === null ? nothing : html`<div class="base" title=${t.baseHint}><dt>${t.base}</dt><dd class="value" data-testid="corrections-base">${at}</dd></div>`}
    <div title=${t.messagesHint(found.sent, found.dropped)}>
      <dt>${t.messages}</dt>
      <dd class="value" data-testid="corrections-messages">${t.count(found.messages, found.dropped)}</dd>
    </div>
  </dl>`;
}

export const corrections: Feature = { glance, isRead: ({ features }) => features.corrections !== null };
