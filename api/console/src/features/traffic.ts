/** Other traffic: a panel with the nearest, and the cylinder and the next seconds of each in the scene. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { Group } from "three";
import { seconds, withUnit } from "../panels/format";
import { icon } from "../panels/icons";
import { toScene } from "../scene/axes";
import type { Eye, Shared } from "../scene/camera";
import { ORDER } from "../scene/materials";
import type { Overlay } from "../scene/overlay";
import type { Palette } from "../scene/palette";
import { Strokes, type Style } from "../scene/strokes";
import type { Features, State } from "../state";
import type { Feature, FeatureLayer, FeaturePanel } from "./feature";

type Traffic = NonNullable<Features["traffic"]>;
type Reported = Traffic["nearest"][number];

export const t = {
  title: "Traffic",
  none: "No track is reported.",
  unread: (age: string): string => `Not read from the service for ${age}`,
  kinds: { manned: "manned", unmanned: "unmanned", vessel: "vessel", ground: "on the ground" },
  near: "NEAR",
  evaded: "kept clear of",
  rows: { away_m: "Away", nearest_m: "Nearest", nearest_s: "In", height_m: "Height", speed_m_s: "Speed", age_s: "Age" },
};

/** Without a reading for so long, nothing that was read is how it is now. */
const UNREAD_S = 3;

export interface Track extends Reported {
  speed_m_s: number;
}

export interface Seen {
  /** Why it is not known what flies; "": it is. */
  problem: string;
  radius_m: number;
  nearest: readonly Track[];
}

/** Traffic at `now_s` of the service's clock: as read last, and moved on since; null: none is configured. Pure. */
export function trafficAt({ features, featuresRead_s, status }: State, now_s: number): Seen | null {
  const read = (features ?? status?.features)?.traffic;
  if (!read || !status) return null;
  const since_s = Math.max(0, now_s - (features === null ? status.time_s : featuresRead_s));
  const isOld = !(since_s < UNREAD_S);
  const moved = (each: Reported): Track => ({
    ...each,
    x_m: each.x_m + since_s * each.velocity_x_m_s,
    y_m: each.y_m + since_s * each.velocity_y_m_s,
    age_s: each.age_s + since_s,
    speed_m_s: Math.hypot(each.velocity_x_m_s, each.velocity_y_m_s),
  });
  return { problem: isOld ? t.unread(seconds(since_s)) : read.problem, radius_m: read.radius_m, nearest: isOld ? [] : read.nearest.map(moved) };
}

function card(track: Track): TemplateResult {
  const fact = (what: keyof typeof t.rows, value: string): TemplateResult =>
    html`<div><dt>${t.rows[what]}</dt><dd data-testid="traffic-${track.id}-${what}">${value}</dd></div>`;
  const look = track.kind === "manned" ? "bad" : "caution";
  return html`<li class="card" data-testid="traffic-${track.id}">
    <header>
      <h3>${track.id}</h3>
      <span class="tag">${t.kinds[track.kind]}</span>
      ${track.near ? html`<strong class="card-state ${look}">${icon("warning")} ${t.near}</strong>` : nothing}
      ${track.evaded ? html`<span class="tag">${t.evaded}</span>` : nothing}
    </header>
    <div class="card-facts">
      <dl class="value">
        ${fact("away_m", withUnit(track.away_m, "m"))} ${fact("nearest_m", withUnit(track.nearest_m, "m"))}
        ${fact("nearest_s", seconds(track.nearest_s))} ${fact("height_m", withUnit(track.height_m ?? NaN, "m"))}
        ${fact("speed_m_s", withUnit(track.speed_m_s, "m/s"))} ${fact("age_s", seconds(track.age_s))}
      </dl>
    </div>
  </li>`;
}

function view(state: State): TemplateResult {
  const seen = trafficAt(state, state.frame?.time_s ?? NaN);
  return html`<div data-testid="traffic">
    ${seen === null || seen.problem === "" ? nothing : html`<p class="problem" data-testid="traffic-problem">${seen.problem}</p>`}
    ${seen?.nearest.length === 0 && seen.problem === "" ? html`<p class="hint">${t.none}</p>` : nothing}
    <ul class="cards">${seen?.nearest.map(card)}</ul>
  </div>`;
}

const panel: FeaturePanel = { name: "feature-traffic", title: t.title, icon: "warning", view };

const AHEAD_S = 10;
const CIRCLE_PARTS = 32;

/** A circle of each cylinder at the track's height, and where it will be. */
class Marks implements FeatureLayer {
  readonly #lines;

  constructor(shared: Shared, into: Group) {
    this.#lines = new Strokes(shared, ORDER.marks, { hidden: false });
    into.add(this.#lines.mesh);
  }

  draw(state: State, time_s: number, palette: Palette, eye: Eye, overlay: Overlay): void {
    const seen = trafficAt(state, time_s);
    this.#lines.clear();
    for (const each of seen?.nearest ?? []) {
      const height_m = each.height_m ?? 0;
      const at = toScene(each.x_m, each.y_m, -height_m);
      const ahead_m = [each.x_m + AHEAD_S * each.velocity_x_m_s, each.y_m + AHEAD_S * each.velocity_y_m_s] as const;
      const style: Style = { color: each.near ? palette.danger : palette.obstacle, alpha: 0.9, width_px: each.near ? 2.4 : 1.2 };
      this.#lines.circle(at, seen!.radius_m, style, undefined, undefined, CIRCLE_PARTS);
      this.#lines.line(at, toScene(...ahead_m, -height_m), style);
      overlay.put(eye, at, `${each.id} · ${t.kinds[each.kind]}`, "thing", -22);
    }
    this.#lines.commit();
  }

  questionAt(): null {
    return null;
  }

  dispose(): void {
    this.#lines.dispose();
  }
}

export const traffic: Feature = { panel, layer: (shared, into) => new Marks(shared, into), isRead: ({ features }) => features.traffic !== null };
