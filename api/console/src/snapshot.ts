// What the service reports: its status, and one frame of the fleet. Types and their constants alone.

import type { components } from "./schemas/schema";

type Schemas = components["schemas"];

/** Content of the stream's text messages: state that changes seldom. */
export type Status = Schemas["Status"];
export type VehicleRecord = Schemas["VehicleRecord"];
/** One of the stations that fly one formation, as the one that answers receives it. */
export type Station = Schemas["StationView"];
export type LogEvent = Schemas["LogEvent"];
export type Command = Schemas["CommandRecord"];
export type PreflightReport = Schemas["PreflightReport"];
export type StoredShow = Schemas["StoredShow"];
export type DrawnSamples = Schemas["DrawnSamples"];
export type PlacedShow = Schemas["PlacedShow"];
export type Site = Schemas["SiteView"];
export type SiteArea = Schemas["SiteAreaView"];
export type Placement = Schemas["Placement"];
/** What each feature beside the formation reports. */
export type Features = Schemas["Features"];
export type ImportedShow = Schemas["ImportedShow"];
export type ShowCheck = Schemas["ShowCheck"];
/** What a timeline marks: of a flight, or of a record. */
export type FlightMarks = Schemas["FlightMarks"];
export type SelectedShow = Schemas["SelectedShow"];
export type ReportBody = Schemas["ReportBody"];
export type ShowAction = Schemas["ShowAction"];
export type ShowPhase = Schemas["ShowPhase"];
export type Obstacle = Schemas["Obstacle"];
export type KillArmed = Schemas["KillArmed"];

/** In the order of gcs/model/lifecycle.py: a frame's column `phase` counts here. */
export const PHASES = [
  "offline", "standby", "takeoff", "hold", "formation", "return", "landing", "lost", "pilot", "killed",
] as const;
export type Phase = (typeof PHASES)[number];

/** In the order of gcs/model/state.py. */
export const MODES = ["unknown", "ready", "takeoff", "hold", "offboard", "return", "land", "position", "other", "terminated"] as const;
export type Mode = (typeof MODES)[number];

/** In the order of gcs/model/lifecycle.py: a frame's header counts here. */
export const SHOW_PHASES = [
  "idle", "countdown", "preflight", "arming", "assembling", "running", "paused", "returning", "aborting", "landed",
  "uncontrolled",
] as const satisfies readonly ShowPhase[];

export const FLAG = { armed: 1, ready: 2, limited: 4, commanded: 8, lit: 16 } as const;

export interface Tick {
  rate_hz: number;
  count: number;
  missed: number;
  p50_ms: number;
  p99_ms: number;
  lateness_p99_ms: number;
}

/** A column of single precision in a frame, by its row in gcs/model/vehicle_columns.py. */
export type FrameColumn = Schemas["FrameColumn"];

/** Columns of numbers over one buffer, n long; vehicle i is `status.vehicles[i]`. Unknown is NaN. Meanings: schema `Vehicle`. */
export type Numbers = Readonly<Record<FrameColumn["name"], Float32Array>>;

/** One instant of the fleet. */
export interface Frame extends Numbers {
  /** Of the status that it belongs to. */
  revision: number;
  /** The service's monotonic clock. */
  time_s: number;
  unix_time_s: number;
  /** The page's clock when it arrived. */
  received_ms: number;
  n: number;
  controlAlive: boolean;
  showPhase: ShowPhase;
  /** Show frame x, y and height, positive up. */
  center_m: readonly [number, number, number] | null;
  target_m: readonly [number, number];
  /** As commanded now. */
  radius_m: number;
  minimumSeparation_m: number;
  tick: Tick;
  setpointsSent: number;
  interventions: number;
  /** The written show's own time. */
  clock_s: number;
  countdown_s: number;
  /** 0 to 1. */
  batteryLeast: number;
  batteryMedian: number;
  /** Until the formation stands. */
  assembled_s: number;
  /** Until all have landed at their pads, if the return began now. */
  home_s: number;
  /** Of the clock that the show follows: hours, minutes, seconds and frames; "": none. */
  label: string;
  /** By how much the show is behind it; NaN: it follows none. */
  behind_s: number;
  /** How fast the show runs by it. */
  tempo: number;
  /** Row of the vehicle with the least battery; beyond all rows: none. */
  batteryLeastRow: number;
  /** Index in `PHASES`. */
  phase: Uint8Array;
  /** Index in `MODES`. */
  mode: Uint8Array;
  /** Index in `LANDED`. */
  landed: Uint8Array;
  /** Bits of `FLAG`. */
  flags: Uint8Array;
  red: Uint8Array;
  green: Uint8Array;
  blue: Uint8Array;
}

/** Without a frame for so long, nothing that is shown is fresh; nor is a position that is older. */
export const STALE_MS = 1000;
