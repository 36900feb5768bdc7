/** The site's fence in the autopilots at a glance: how many vehicles have it, and who is beyond it. */

import { html, nothing, type TemplateResult } from "lit-html";
import { icon } from "../panels/icons";
import type { Features, State } from "../state";
import type { Feature } from "./feature";

type Fences = NonNullable<Features["fences"]>;

export const t = {
  title: "Fence in the autopilots",
  have: "Fence",
  haveHint: (corners: number): string => `Vehicles that have exactly the site's fence, of ${corners} corners`,
  count: (verified: number, all: number): string => `${verified} of ${all}`,
  breached: "Beyond it",
};

function breach({ breached }: Fences): TemplateResult | typeof nothing {
  if (breached === "") return nothing;
  return html`<div class="stopped">
    <dt>${t.breached}</dt>
    <dd class="value" data-testid="fences-breached">${icon("warning")}${breached}</dd>
  </div>`;
}

function glance({ features, status }: State): TemplateResult | null {
  const found = (features ?? status?.features)?.fences;
  if (!found || !status || status.replay) return null;
  const lacks = found.missing !== "";
  return html`<dl class="energy glance" aria-label=${t.title} data-testid="fences">
    <div class=${lacks ? "stopped" : ""} title=${lacks ? found.missing : t.haveHint(found.corners)}>
      <dt>${t.have}</dt>
      <dd class="value" data-testid="fences-verified">
        ${lacks ? icon("warning") : nothing}${t.count(found.verified, status.vehicles.length)}
      </dd>
    </div>
    ${breach(found)}
  </dl>`;
}

export const fences: Feature = { glance, isRead: ({ features }) => features.fences !== null };
