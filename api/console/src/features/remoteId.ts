/** Remote ID at a glance: the swarm's area as it is sent, and how many transponders are ready. */

import { html, nothing, type TemplateResult } from "lit-html";
import { icon } from "../panels/icons";
import type { Features, State } from "../state";
import type { Feature } from "./feature";

type RemoteId = NonNullable<Features["remote_id"]>;

export const t = {
  title: "Remote ID",
  ready: "Transponders",
  readyHint: "Vehicles with a transponder for Remote ID that is ready",
  count: (ready: number, all: number): string => `${ready} of ${all}`,
  area: "Area",
  within: (count: number, radius: number): string => `${count} within ${Math.ceil(radius)} m`,
};

function area({ area_count, area_radius_m, problem }: RemoteId): TemplateResult {
  const bad = problem !== "";
  return html`<div class=${bad ? "stopped" : ""} title=${problem}>
    <dt>${t.area}</dt>
    <dd class="value" data-testid="remote-id-area">
      ${bad ? icon("warning") : nothing}${t.within(area_count, area_radius_m)}
    </dd>
  </div>`;
}

function glance({ features, status }: State): TemplateResult | null {
  const found = (features ?? status?.features)?.remote_id;
  if (!found || !status || status.replay) return null;
  const lacks = found.missing !== "";
  return html`<dl class="energy glance" aria-label=${t.title} data-testid="remote-id">
    <div class=${lacks ? "stopped" : ""} title=${lacks ? found.missing : t.readyHint}>
      <dt>${t.ready}</dt>
      <dd class="value" data-testid="remote-id-ready">
        ${lacks ? icon("warning") : nothing}${t.count(found.ready, status.vehicles.length)}
      </dd>
    </div>
    ${area(found)}
  </dl>`;
}

export const remoteId: Feature = { glance, isRead: ({ features }) => features.remote_id !== null };
