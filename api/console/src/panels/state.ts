/** State of the panels: what is open, what is typed, how the table is sorted. Plain data. */

import type { ShowCheck, StoredShow } from "../snapshot";
import type { Sort } from "./rows";

/**
 * wide: a panel on either side of the scene. single: one panel beside the scene.
 * sheet: a panel is a sheet at the bottom, for phones and tablets held upright.
 * side: the flight commands stand on the right, for a window that is wide and low.
 */
export type Layout = "wide" | "single" | "sheet" | "side";
export type PanelSide = "left" | "right";
/** What is changed together, by one button. */
export type Group = "formation" | "orbit" | "target" | "yaw";
export type LeftPanel = "preflight" | "shows" | "shape" | "obstacles";
/** Of a feature beside the formation. */
export type FeaturePanelName = `feature-${string}`;
export type RightPanel = "fleet" | "vehicle" | "events" | "plots" | "stations" | "report" | FeaturePanelName;
export type Sheet = "start" | "begin" | "kill" | "help";

/** Something that the service, or the page, refused. */
export interface Refusal {
  unix_time_s: number;
  text: string;
}

/** The order of the fleet table; sorted again once a second, so that rows do not jump under a finger. */
export interface Table {
  command: readonly number[]; // indices of vehicles
  nearest_m: Float64Array;
  phases: Readonly<Record<string, number>>; // how many are in each
  problem: string; // with the filter
  made_ms: number;
}

export interface PanelState {
  left: LeftPanel | null;
  right: RightPanel | null;
  sheet: Sheet | null;
  layout: Layout;
  front: PanelSide | null; // opened last; where one panel is shown at a time, this side's
  tall: boolean; // the panel's sheet covers the scene
  allAlarms: boolean; // the list of alarms covers the panel
  timeline: boolean; // open where there is little room for it
  course_px: number; // the timeline's width; 0: not known yet
  plan: boolean; // of the show, though a flight of it has just ended
  tools: boolean; // the top bar's second row, where it has one
  drafts: Readonly<Record<string, string>>; // typed and not sent, by field
  sort: Sort;
  filter: string;
  grid: boolean; // the fleet as a grid of pills, not as a table
  scroll_px: number;
  room_px: number;
  table: Table;
  shows: readonly StoredShow[] | null;
  checks: Readonly<Record<string, ShowCheck>>;
  showsRefused: Readonly<Record<string, { hash: string; problem: string }>>; // shows that Select refused, by the hash then
  showsProblem: string;
  openShow: string | null;
  reading: string; // the button that was pressed for a drawing that is being read; empty: none
  wasDown: boolean; // with the newest status: a start could be prepared
  preflightRead_ms: number; // the page's clock; NaN: not yet
  preflightFor: string; // the vehicles it was requested for, with spaces between; empty: all that are online
  preflightProblem: string;
  allChecks: boolean; // also those that pass
  sure: string; // what waits for a second press: "obstacle:tower", "show:parade", "lead", "begin:1795000000"
  excluding: string | null;
  editing: string | null; // an obstacle's id; "": a new one
  startAt: boolean; // at a clock time
  beginAt: boolean; // the show, at a clock time
  startNamed: boolean; // those named only
  killNamed: ReadonlySet<string> | null; // as chosen in the sheet; null: all that are not offline
  holding_ms: number | null; // since when the kill is held
  openCommand: string | null;
  eventList: "commands" | "lines" | "refused";
  refusals: readonly Refusal[]; // newest first
  reportProblem: string;
  reportReading: boolean;
}

export const ROW_PX = 36;
export const REFUSALS_KEPT = 100;
export const HOLD_MS = 2000;

export function initialDesk(): PanelState {
  return {
    left: "preflight",
    right: "fleet",
    sheet: null,
    layout: "wide",
    front: "right",
    tall: false,
    allAlarms: false,
    timeline: false,
    course_px: 0,
    plan: false,
    tools: false,
    drafts: {},
    sort: { column: "id", descending: false },
    filter: "",
    grid: false,
    scroll_px: 0,
    room_px: 600,
    table: { command: [], nearest_m: new Float64Array(0), phases: {}, problem: "", made_ms: -Infinity },
    shows: null,
    checks: {},
    showsRefused: {},
    showsProblem: "",
    openShow: null,
    reading: "",
    wasDown: true,
    preflightRead_ms: NaN,
    preflightFor: "",
    preflightProblem: "",
    allChecks: false,
    sure: "",
    excluding: null,
    editing: null,
    startAt: false,
    beginAt: false,
    startNamed: false,
    killNamed: new Set(),
    holding_ms: null,
    openCommand: null,
    eventList: "lines",
    refusals: [],
    reportProblem: "",
    reportReading: false,
  };
}
