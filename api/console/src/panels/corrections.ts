/** Corrections for RTK at a glance: age, receivers that use them, base, messages. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { Corrections, State } from "../state";
import { texts } from "../texts";
import { seconds, withUnit } from "./format";
import { icon } from "./icons";

const t = texts.corrections;
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

export function corrections({ corrections: found, status }: State): TemplateResult | typeof nothing {
  if (found === null || status === null) return nothing;
  const fixes = (type: number): number => status.vehicles.filter((each) => each.fix_type === type).length;
  const at = base(found);
  const stopped = found.problem !== "";
  return html`<dl class="energy corrections" aria-label=${t.title} data-testid="corrections">
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
