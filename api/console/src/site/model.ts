/** The site, and what an operator changes of it before it is stored. Pure. */

import { fromShowFrame, type Origin } from "../scene/mercator";
import type { Site } from "../snapshot";
import { AREAS_MAX, centimetres, isNested, newArea, type Area, type AreaKind, type Corner } from "./area";

/** What is wrong, where the service says so; -1: of no area in particular. */
export interface Problem {
  area: number;
  corners: readonly number[];
  text: string;
}

export interface SiteEdit {
  /** Of the file that is changed. */
  version: string;
  name: string;
  areas: readonly Area[];
  past: readonly (readonly Area[])[];
  future: readonly (readonly Area[])[];
  /** Steps of one drag, or of one held key, are undone together; "": the next step is one of its own. */
  gesture: string;
  /** Chosen. */
  area: number;
  corner: number;
  problems: readonly Problem[];
  isSaving: boolean;
}

export interface SiteState {
  /** As the service's file has it; null: not read, or there is none. */
  stored: Site | null;
  /** null: nothing is changed. */
  edit: SiteEdit | null;
}

export const NO_SITE: SiteState = { stored: null, edit: null };

export type Step =
  | { what: "move"; area: number; corner: number; x_m: number; y_m: number }
  /** In the middle of the side that begins at `corner`. */
  | { what: "add"; area: number; corner: number }
  | { what: "remove"; area: number; corner: number }
  | { what: "height"; area: number; key: "height_min_m" | "height_max_m"; value_m: number | null }
  | { what: "add-area"; kind: AreaKind }
  | { what: "remove-area"; area: number };

export type SiteMessage =
  /** As the service has it; `isSaved`: it is the answer to what was edited. */
  | { kind: "site"; site: Site | null; isSaved: boolean }
  | { kind: "site-edit"; how: "begin" | "discard" | "undo" | "redo" }
  | { kind: "site-choose"; area: number; corner: number }
  | { kind: "site-step"; step: Step; gesture: string }
  | { kind: "site-saving" }
  /** Why it is not stored, one problem a line. */
  | { kind: "site-refused"; reason: string };

export const CORNERS_MIN = 3;
export const CORNERS_MAX = 60;
const PAST_MAX = 200;

export function updateSite(site: SiteState, message: SiteMessage): SiteState {
  const { edit } = site;
  switch (message.kind) {
    case "site":
      return { stored: message.site, edit: message.isSaved ? null : edit };
    case "site-edit":
      if (message.how === "begin") return { ...site, edit: edit ?? (site.stored === null ? null : begun(site.stored)) };
      if (message.how === "discard" || edit === null) return { ...site, edit: null };
      return { ...site, edit: message.how === "undo" ? undone(edit) : redone(edit) };
    case "site-choose":
      return edit === null ? site : { ...site, edit: chosen({ ...edit, gesture: "" }, message.area, message.corner) };
    case "site-step":
      return edit === null || edit.isSaving ? site : { ...site, edit: stepped(edit, message.step, message.gesture) };
    case "site-saving":
      return edit === null ? site : { ...site, edit: { ...edit, isSaving: true, gesture: "", problems: [] } };
    case "site-refused":
      return edit === null ? site : { ...site, edit: refused(edit, message.reason) };
  }
}

export function areasOf(site: Site): Area[] {
  return site.areas.map(({ kind, name, corners, height_min_m, height_max_m }) => ({
    kind, name, height_min_m, height_max_m,
    corners: corners.map(({ x_m, y_m, latitude_deg, longitude_deg }) => ({ x_m, y_m, read: { latitude_deg, longitude_deg } })),
  }));
}

/** The areas as they are shown: with what was changed. */
export function shownAreas({ stored, edit }: SiteState): readonly Area[] {
  return edit?.areas ?? (stored === null ? [] : areasOf(stored));
}

export const isChanged = (edit: SiteEdit): boolean => edit.past.length > 0;

function begun(site: Site): SiteEdit {
  return {
    version: site.version, name: site.name, areas: areasOf(site), past: [], future: [], gesture: "", area: 0, corner: 0, problems: [], isSaving: false,
  };
}

/** Within what there is. */
function chosen(edit: SiteEdit, area: number, corner: number): SiteEdit {
  const at = Math.max(0, Math.min(area, edit.areas.length - 1));
  return { ...edit, area: at, corner: Math.max(0, Math.min(corner, (edit.areas[at]?.corners.length ?? 1) - 1)) };
}

function undone(edit: SiteEdit): SiteEdit {
  const before = edit.past.at(-1);
  if (before === undefined || edit.isSaving) return edit;
  const next = { ...edit, areas: before, past: edit.past.slice(0, -1), future: [edit.areas, ...edit.future], gesture: "", problems: [] };
  return chosen(next, edit.area, edit.corner);
}

function redone(edit: SiteEdit): SiteEdit {
  const [after, ...future] = edit.future;
  if (after === undefined || edit.isSaving) return edit;
  const next = { ...edit, areas: after, past: [...edit.past, edit.areas], future, gesture: "", problems: [] };
  return chosen(next, edit.area, edit.corner);
}

function stepped(edit: SiteEdit, step: Step, gesture: string): SiteEdit {
  const made = changedAreas(edit, step);
  if (made === null) return edit;
  const goesOn = gesture !== "" && gesture === edit.gesture;
  const past = goesOn ? edit.past : [...edit.past, edit.areas].slice(-PAST_MAX);
  return chosen({ ...edit, areas: made.areas, past, future: [], gesture, problems: [] }, made.area, made.corner);
}

interface Changed {
  areas: readonly Area[];
  /** Chosen then. */
  area: number;
  corner: number;
}

/** null: that is not possible, or changes nothing. */
function changedAreas({ areas, corner }: SiteEdit, step: Step): Changed | null {
  if (step.what === "add-area") {
    return whyNotAdded(areas, step.kind) === null ? { areas: [...areas, newArea(areas, step.kind)], area: areas.length, corner: 0 } : null;
  }
  const area = areas[step.area];
  if (area === undefined) return null;
  if (step.what === "remove-area") {
    return areas.length > 1 ? { areas: areas.filter((_, k) => k !== step.area), area: step.area, corner: 0 } : null;
  }
  const changed = changedArea(area, step);
  if (changed === null) return null;
  const at = step.what === "height" ? corner : step.what === "add" ? step.corner + 1 : step.corner;
  return { areas: areas.map((each, k) => (k === step.area ? changed : each)), area: step.area, corner: at };
}

/** What of the service's limits an area more would break; null: nothing. */
export function whyNotAdded(areas: readonly Area[], kind: AreaKind): "most" | "another" | null {
  if (areas.length >= AREAS_MAX) return "most";
  return isNested(kind) && areas.some((each) => each.kind === kind) ? "another" : null;
}

/** null: that is not possible, or changes nothing. */
function changedArea(area: Area, step: Exclude<Step, { what: "add-area" | "remove-area" }>): Area | null {
  const { corners } = area;
  switch (step.what) {
    case "move": {
      const [x_m, y_m, was] = [centimetres(step.x_m), centimetres(step.y_m), corners[step.corner]];
      if (was === undefined || !Number.isFinite(x_m + y_m) || (was.x_m === x_m && was.y_m === y_m)) return null;
      return { ...area, corners: corners.map((each, k) => (k === step.corner ? { x_m, y_m, read: null } : each)) };
    }
    case "add": {
      const [from, to] = [corners[step.corner], corners[(step.corner + 1) % corners.length]];
      if (from === undefined || to === undefined || corners.length >= CORNERS_MAX) return null;
      const added = { x_m: centimetres((from.x_m + to.x_m) / 2), y_m: centimetres((from.y_m + to.y_m) / 2), read: null };
      return { ...area, corners: [...corners.slice(0, step.corner + 1), added, ...corners.slice(step.corner + 1)] };
    }
    case "remove":
      if (corners.length <= CORNERS_MIN || corners[step.corner] === undefined) return null;
      return { ...area, corners: corners.filter((_, k) => k !== step.corner) };
    case "height":
      return area[step.key] === step.value_m || (step.value_m === null && step.key === "height_min_m") ? null : { ...area, [step.key]: step.value_m };
  }
}

function refused(edit: SiteEdit, reason: string): SiteEdit {
  const problems = reason.replace(/^site = [^:]*: /, "").split("\n").map((text) => problemOf(edit.areas, text));
  const first = problems.find((each) => each.area >= 0);
  const next = { ...edit, isSaving: false, problems };
  return first === undefined ? next : chosen(next, first.area, first.corners[0] ?? edit.corner);
}

/** Which area and which corners a problem is about: "area 2, no-fly 'mast': side 1-2 and side 3-4 ...". */
export function problemOf(areas: readonly Area[], text: string): Problem {
  const number = /^area (\d+)/.exec(text)?.[1];
  const named = firstNamed(areas, text);
  const area = number === undefined ? named : Number(number) - 1;
  const found = [...text.matchAll(/corners? (\d+)(?: and (\d+))?|side (\d+)-(\d+)/g)].flatMap((each) => each.slice(1));
  const corners = found.flatMap((each) => (each === undefined ? [] : [Number(each) - 1]));
  const isThere = area >= 0 && area < areas.length;
  return { area: isThere ? area : -1, corners: isThere ? corners.filter((each) => each < areas[area]!.corners.length) : [], text };
}

/** The area that the text names first; -1: none. */
function firstNamed(areas: readonly Area[], text: string): number {
  const at = areas.map(({ kind, name }) => text.indexOf(`${kind} '${name}'`));
  const there = at.filter((each) => each >= 0);
  return there.length === 0 ? -1 : at.indexOf(Math.min(...there));
}

/** The whole site as GeoJSON; what was not moved is as it was read. */
export function geojson({ name, areas }: SiteEdit, origin: Origin): string {
  const place = ({ x_m, y_m, read }: Corner): [number, number] => {
    const { latitude_deg, longitude_deg } = read ?? fromShowFrame(x_m, y_m, origin);
    return [degrees(longitude_deg), degrees(latitude_deg)];
  };
  const features = areas.map(({ kind, name: title, corners, height_min_m, height_max_m }) => ({
    type: "Feature",
    properties: { kind, name: title, height_min_m, ...(height_max_m === null ? {} : { height_max_m }) },
    geometry: { type: "Polygon", coordinates: [[...corners, corners[0]!].map(place)] },
  }));
  return JSON.stringify({ type: "FeatureCollection", name, features });
}

/** As autopilots receive them. */
const degrees = (value: number): number => Math.round(1e7 * value) / 1e7;
