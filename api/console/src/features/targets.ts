/** Targets that the formation can follow: a panel that shows how well each is known, and their marks in the scene. */

import { html, nothing, svg, type TemplateResult } from "lit-html";
import type { Group } from "three";
import type { PanelActions } from "../panels/actions";
import { button, twice } from "../panels/controls";
import { seconds, UNKNOWN, withUnit } from "../panels/format";
import { icon, type IconName } from "../panels/icons";
import { toScene, type Vec3 } from "../scene/axes";
import type { Eye, Shared } from "../scene/camera";
import { ORDER } from "../scene/materials";
import type { Overlay } from "../scene/overlay";
import type { Palette } from "../scene/palette";
import { project } from "../scene/picking";
import { Strokes, type Style } from "../scene/strokes";
import { may, PAST_S, type Features, type State } from "../state";
import type { Question, Feature, FeatureLayer, FeaturePanel } from "./feature";

type Reported = NonNullable<Features["targets"]>["targets"][number];

export const t = {
  title: "Targets",
  states: { none: "no report yet", tracked: "tracked", coasting: "coasting", lost: "LOST", unread: "not known" },
  unread: (age: string): string => `not read from the service for ${age}`,
  followed: "followed",
  selected: "selected",
  rows: { age_s: "Age", rate_hz: "Reports", speed_m_s: "Speed", radius_m: "2 sigma", away_m: "From centre", clearance_m: "Kept clear", height_m: "Height" },
  off: (now: string, most: string): string => `Tracking error: ${now}, at most ${most} in ${PAST_S} s`,
  follow: (name: string): string => `Follow ${name}`,
  again: (name: string): string => `Follow ${name} again`,
  sure: (name: string, away: string): string => (away === UNKNOWN ? `Yes, follow ${name}` : `Yes, fly ${away} to ${name}`),
  isFollowed: (name: string): string => `${name} is selected already`,
  follows: (name: string): string => `${name} is selected to be followed`,
  hold: "Hold here",
  limits: (speed: string, reach: string): string => `Followed up to ${speed}, and within ${reach} of the origin`,
  holds: "The target stands where it is",
  byShow: (show: string): string => `Show ${show} moves the target itself; the selected one is followed at its live cues.`,
  byLead: "The station that leads moves the target; one that is selected here is followed once this station leads.",
};

const LOOKS: Record<keyof typeof t.states, readonly [IconName, "good" | "caution" | "bad"]> = {
  none: ["question", "caution"], tracked: ["check", "good"], coasting: ["caution", "caution"], lost: ["warning", "bad"], unread: ["question", "bad"],
};

/** Without a reading for so long, nothing that was read is how it is now. */
const UNREAD_S = 3;

/** One target at an instant. NaN: not known, as where a lost one is. */
export interface Fix {
  name: string;
  source: string;
  state: keyof typeof t.states;
  why: string;
  isSelected: boolean;
  age_s: number;
  rate_hz: number;
  x_m: number;
  y_m: number;
  velocity_x_m_s: number;
  velocity_y_m_s: number;
  /** Of the circle of two standard deviations. */
  radius_m: number;
  height_m: number;
  clearance_m: number;
}

function fixOf(read: Reported, selected: string, since_s: number): Fix {
  const isOld = !(since_s < UNREAD_S);
  const state = isOld ? "unread" : read.state;
  const placed = (value: number | null): number => (state === "tracked" || state === "coasting" ? (value ?? NaN) : NaN);
  return {
    name: read.name,
    source: read.source,
    state,
    why: isOld ? t.unread(seconds(since_s)) : read.why,
    isSelected: read.name === selected,
    age_s: (read.age_s ?? NaN) + (isOld ? since_s : 0),
    rate_hz: state === "tracked" ? (read.rate_hz ?? NaN) : NaN,
    x_m: placed(read.x_m) + since_s * placed(read.velocity_x_m_s),
    y_m: placed(read.y_m) + since_s * placed(read.velocity_y_m_s),
    velocity_x_m_s: placed(read.velocity_x_m_s),
    velocity_y_m_s: placed(read.velocity_y_m_s),
    radius_m: 2 * placed(read.deviation_m),
    height_m: placed(read.height_m),
    clearance_m: read.clearance_m,
  };
}

/** All targets at `now_s` of the service's clock: as read last, and moved on since. Pure. */
export function fixesAt({ features, featuresRead_s, status }: State, now_s: number): readonly Fix[] {
  const read = (features ?? status?.features)?.targets;
  if (!read || !status) return [];
  const since_s = Math.max(0, now_s - (features === null ? status.time_s : featuresRead_s));
  const selected = status.features.targets?.selected ?? ""; // the status is sent at once when it changes
  return read.targets.map((each) => fixOf(each, selected, since_s));
}

/** How far the formation's centre is from it, level. */
export function away_m({ frame }: State, { x_m, y_m }: Fix): number {
  return frame?.center_m ? Math.hypot(frame.center_m[0] - x_m, frame.center_m[1] - y_m) : NaN;
}

/** How far the centre was from a target, or from the orbit around it, while that was selected: parts without a gap of
 * [seconds before now, m]. Pure. */
export function offs(state: State, name: string, now_s: number): [number, number][][] {
  const parts: [number, number][][] = [];
  let last_s = NaN;
  for (const { read_s, features } of state.featuresPast) {
    const off_m = features.targets?.selected === name ? features.targets.off_m : null;
    if (off_m === null || now_s - read_s > PAST_S) continue;
    if (!(read_s - last_s < UNREAD_S)) parts.push([]);
    parts.at(-1)!.push([read_s - now_s, off_m]);
    last_s = read_s;
  }
  return parts;
}

/** The plot of it; empty where nothing was read yet. */
function offPlot(state: State, { name }: Fix): TemplateResult | typeof nothing {
  const now_s = state.frame?.time_s ?? NaN;
  const parts = offs(state, name, now_s);
  const all = parts.flat();
  if (all.length === 0) return nothing;
  const most_m = Math.max(...all.map(([, off_m]) => off_m));
  const isNow = all.at(-1)![0] > -UNREAD_S;
  const words = t.off(withUnit(isNow ? all.at(-1)![1] : NaN, "m", 2), withUnit(most_m, "m", 2));
  const points = (part: [number, number][]): string => part.map(([at_s, off_m]) => `${at_s + PAST_S},${40 * (1 - off_m / Math.max(1, most_m))}`).join(" ");
  return html`<figure class="off-plot" data-testid="target-${name}-plot">
    <figcaption>${words}</figcaption>
    <svg viewBox="0 -1 ${PAST_S} 42" preserveAspectRatio="none" role="img" aria-label=${words}>${parts.map((part) => svg`<polyline points=${points(part)} />`)}</svg>
  </figure>`;
}

const NAME = "feature-targets";

const sureOf = (name: string): string => `target:${name}`;

/** What moves the target in place of the selected one; "": nothing. */
function ledBy({ status }: State): string {
  const show = status?.show.selected;
  if (show && !show.target_is_live) return t.byShow(show.name);
  return status?.stations.some((each) => each.own && !each.leads) ? t.byLead : "";
}

const isPlaced = ({ x_m, y_m }: Fix): boolean => Number.isFinite(x_m + y_m);

/** Followed while it is known where it is, and nothing else leads; "": it is not selected. */
function roleOf(state: State, fix: Fix): string {
  if (!fix.isSelected) return "";
  return isPlaced(fix) && ledBy(state) === "" ? t.followed : t.selected;
}

function card(state: State, actions: PanelActions, fix: Fix, why: string): TemplateResult {
  const { name, isSelected } = fix;
  const isGood = fix.state === "tracked";
  const [sign, look] = LOOKS[fix.state];
  const away = withUnit(away_m(state, fix), "m");
  const fact = (what: keyof typeof t.rows, value: string): TemplateResult =>
    html`<div><dt>${t.rows[what]}</dt><dd data-testid="target-${name}-${what}">${value}</dd></div>`;
  return html`<li class="card ${isSelected ? "selected" : ""}" data-testid="target-${name}" aria-current=${isSelected ? "true" : nothing}>
    <header>
      ${icon("target")}
      <h3>${name}</h3>
      <span class="tag">${fix.source}</span>
      ${isSelected ? html`<span class="tag accent" data-testid="target-${name}-selected">${icon("check")}${roleOf(state, fix)}</span>` : nothing}
      <strong class="card-state ${look}" data-testid="target-${name}-state">${icon(sign)} ${t.states[fix.state]}</strong>
    </header>
    ${fix.why === "" ? nothing : html`<p class=${look === "bad" ? "problem" : "dim"} data-testid="target-${name}-why">${fix.why}</p>`}
    <div class="card-facts">
      <dl class="value">
        ${fact("age_s", seconds(fix.age_s))} ${fact("rate_hz", withUnit(fix.rate_hz, "Hz"))}
        ${fact("speed_m_s", withUnit(Math.hypot(fix.velocity_x_m_s, fix.velocity_y_m_s), "m/s"))} ${fact("radius_m", withUnit(fix.radius_m, "m"))}
        ${isSelected ? fact("away_m", away) : nothing} ${Number.isNaN(fix.height_m) ? nothing : fact("height_m", withUnit(fix.height_m, "m"))}
        ${fix.clearance_m > 0 ? fact("clearance_m", withUnit(fix.clearance_m, "m")) : nothing}
      </dl>
    </div>
    ${isSelected ? offPlot(state, fix) : nothing}
    <div class="buttons">
      ${twice(state, actions, {
        id: `target-follow-${name}`,
        label: isSelected && !isGood ? t.again(name) : t.follow(name),
        sure: t.sure(name, away),
        about: sureOf(name),
        why: isSelected && isGood ? t.isFollowed(name) : why,
        press: () => void actions.ask(t.follow(name), (api) => api.POST("/api/v1/targets/select", { body: { name } }), t.follows(name)),
      })}
    </div>
  </li>`;
}

function limits({ features, status }: State): string {
  const read = (features ?? status?.features)?.targets;
  return t.limits(withUnit(read?.follows_m_s ?? NaN, "m/s"), withUnit(read?.reach_m ?? NaN, "m"));
}

function view(state: State, actions: PanelActions, why: string): TemplateResult {
  const led = ledBy(state);
  const hold = (): void => {
    actions.set({ sure: "" });
    void actions.ask(t.hold, (api) => api.POST("/api/v1/targets/hold"), t.holds);
  };
  return html`<div data-testid="targets">
    <div class="buttons">${button(actions, { id: "target-hold", label: t.hold, icon: "hold", why, press: hold })}</div>
    ${led === "" ? nothing : html`<p class="hint">${led}</p>`}
    <p class="hint" data-testid="targets-limits">${limits(state)}</p>
    <ul class="cards">
      ${fixesAt(state, state.frame?.time_s ?? NaN).map((each) => card(state, actions, each, why))}
    </ul>
  </div>`;
}

const panel: FeaturePanel = { name: NAME, title: t.title, icon: "target", view };

const AHEAD_S = 5;
const TRACK_S = 60;
/** Places that are farther apart in time, or need a greater speed, are not joined. */
const [JOINED_S, JOINED_M_S] = [3, 100];
const MARK_PX = 9;
const MARK_M = 0.8;
const REACH_PX = 18;
const CIRCLE_PARTS = 32;
const DASH = 0.016; // with its gap, of what the picture spans

type Place = readonly [time_s: number, x_m: number, y_m: number];

const placeOf = (time_s: number, { x_m, y_m }: Fix): Place => [time_s, x_m, y_m];
const onGround = ([, x_m, y_m]: Place): Vec3 => toScene(x_m, y_m, 0);
const isJoined = ([from_s, from_x_m, from_y_m]: Place, [to_s, x_m, y_m]: Place): boolean =>
  to_s - from_s <= JOINED_S && Math.hypot(x_m - from_x_m, y_m - from_y_m) <= JOINED_M_S * (to_s - from_s);

/** Where one was, at most once for each reading; oldest first. */
export class Track {
  readonly places: Place[] = [];

  add(time_s: number, fix: Fix): void {
    if (isPlaced(fix)) this.places.push(placeOf(time_s, fix));
    while (this.places.length > 1 && !(Math.abs(time_s - this.places[0]![0]) <= TRACK_S)) this.places.shift(); // the last one stays
  }

  /** Pairs that are joined. */
  lines(): [Place, Place][] {
    return this.places.slice(1).flatMap((to, k) => (isJoined(this.places[k]!, to) ? [[this.places[k]!, to] as [Place, Place]] : []));
  }
}

const thin = ({ target }: Palette): Style => ({ color: target, alpha: 0.6, width_px: 1.2 });

class Marks implements FeatureLayer {
  readonly #lines;
  readonly #trackLines; // collected again with each reading only
  readonly #trackOf = new Map<string, Track>();
  #read: Features | null = null;
  #palette: Palette | null = null;
  #drawn: { at: Vec3; question: Question }[] = [];

  constructor(shared: Shared, into: Group) {
    this.#lines = new Strokes(shared, ORDER.marks, { hidden: false });
    this.#trackLines = new Strokes(shared, ORDER.marks, { hidden: false });
    into.add(this.#trackLines.mesh, this.#lines.mesh);
  }

  draw(state: State, time_s: number, palette: Palette, eye: Eye, overlay: Overlay): void {
    const fixes = fixesAt(state, time_s);
    if (state.features !== this.#read || palette !== this.#palette) this.#trace(fixes, state.features !== this.#read, time_s, palette);
    [this.#read, this.#palette] = [state.features, palette];
    this.#drawn = [];
    this.#lines.clear();
    for (const fix of fixes) this.#mark(state, time_s, fix, palette, eye, overlay);
    this.#lines.commit();
  }

  #trace(fixes: readonly Fix[], isRead: boolean, time_s: number, palette: Palette): void {
    this.#trackLines.clear();
    for (const fix of fixes) {
      const track = this.#trackOf.get(fix.name) ?? new Track();
      this.#trackOf.set(fix.name, track);
      if (isRead) track.add(time_s, fix);
      for (const [from, to] of track.lines()) this.#trackLines.line(onGround(from), onGround(to), thin(palette));
    }
    this.#trackLines.commit();
  }

  /** Tracked: a diamond in a circle. Coasting: the same, dashed. Else: a cross where it was last. */
  #mark(state: State, time_s: number, fix: Fix, palette: Palette, eye: Eye, overlay: Overlay): void {
    const last = this.#trackOf.get(fix.name)?.places.at(-1);
    const place = isPlaced(fix) ? placeOf(time_s, fix) : last;
    if (place === undefined) return;
    const at = onGround(place);
    if (last !== undefined && last !== place && isJoined(last, place)) this.#lines.line(onGround(last), at, thin(palette));
    const dash_m = fix.state === "tracked" ? 0 : DASH * eye.pose.span_m;
    const style: Style = { color: palette.target, alpha: 0.95, width_px: fix.isSelected ? 2.8 : 1.6 };
    const size_m = Math.max(MARK_M, MARK_PX * eye.pixelAt_m(at));
    const corner = (right: number, up: number): Vec3 => {
      const { right: r, up: u } = eye.basis;
      return [at[0] + size_m * (right * r[0] + up * u[0]), at[1] + size_m * (right * r[1] + up * u[1]), at[2] + size_m * (right * r[2] + up * u[2])];
    };
    if (isPlaced(fix)) {
      const corners = [corner(1, 0), corner(0, 1), corner(-1, 0), corner(0, -1)] as const;
      corners.forEach((each, k) => this.#lines.line(each, corners[(k + 1) % 4]!, { ...style, dash_m: dash_m && size_m / 2 }));
      this.#lines.circle(at, fix.radius_m, { ...thin(palette), alpha: 0.9, dash_m }, undefined, undefined, CIRCLE_PARTS);
      const ahead = toScene(fix.x_m + AHEAD_S * fix.velocity_x_m_s, fix.y_m + AHEAD_S * fix.velocity_y_m_s, 0);
      this.#lines.line(at, ahead, { ...style, dash_m });
    } else {
      this.#lines.line(corner(-1, -1), corner(1, 1), style);
      this.#lines.line(corner(-1, 1), corner(1, -1), style);
    }
    const words = [fix.name, roleOf(state, fix), fix.state === "tracked" ? "" : t.states[fix.state]];
    overlay.put(eye, at, words.filter(Boolean).join(" · "), "thing", -22);
    const isOffered = may(state, "operate") && !(fix.isSelected && fix.state === "tracked");
    this.#drawn.push({ at, question: { panel: NAME, sure: isOffered ? sureOf(fix.name) : "" } });
  }

  questionAt(px: number, py: number, { basis, pose, screen }: Eye): Question | null {
    const off_px = ({ at }: { at: Vec3 }): number => {
      const seen = project(basis, pose, screen, at);
      return seen === null ? Infinity : Math.hypot(seen.px - px, seen.py - py);
    };
    const nearest = this.#drawn.toSorted((a, b) => off_px(a) - off_px(b))[0];
    return nearest !== undefined && off_px(nearest) <= REACH_PX ? nearest.question : null;
  }

  dispose(): void {
    this.#lines.dispose();
    this.#trackLines.dispose();
  }
}

export const targets: Feature = { panel, layer: (shared, into) => new Marks(shared, into), isRead: ({ features }) => features.targets !== null };
