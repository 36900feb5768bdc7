// The page's one state. Everything that is shown follows from it; `update` alone makes the next one.

import { initialDesk, type DeskState } from "./desk/state";
import { initialAttention, type Attention } from "./alarms/attention";
import { NOTHING_SELECTED, type Selection } from "./selection";
import type { components } from "./wire/schema";

type Schemas = components["schemas"];

/** What the stream's text messages say: what changes seldom. */
export type Status = Schemas["Status"];
export type StatusVehicle = Schemas["StatusVehicle"];
export type Happening = Schemas["Happening"];
export type Order = Schemas["Order"];
export type PreflightReport = Schemas["Preflight"];
export type StoredShow = Schemas["StoredShow"];
export type ShowCheck = Schemas["ShowCheck"];
export type ReplayMarks = Schemas["ReplayMarks"];
export type CertificateReport = Schemas["CertificateReport"];
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
export const MODES = ["unknown", "ready", "takeoff", "hold", "offboard", "return", "land", "position", "other"] as const;
export type Mode = (typeof MODES)[number];

/** In the order of gcs/model/lifecycle.py: a frame's header counts here. */
export const SHOW_PHASES = [
  "idle", "countdown", "preflight", "arming", "assembling", "running", "paused", "returning", "aborting", "landed",
  "uncontrolled",
] as const satisfies readonly ShowPhase[];

/** MAV_LANDED_STATE. */
export const LANDED = ["unknown", "on ground", "in air", "takeoff", "landing"] as const;

export const FLAG = { armed: 1, ready: 2, restrained: 4, commanded: 8, light: 16 } as const;

export interface Tick {
  rate_hz: number;
  count: number;
  missed: number;
  p50_ms: number;
  p99_ms: number;
  lateness_p99_ms: number;
}

/** One instant of the fleet: columns over one buffer, n long; vehicle i is `status.vehicles[i]`. Unknown is NaN. */
export interface Frame {
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
  /** Row of the vehicle with the least battery; beyond all rows: none. */
  batteryLeastRow: number;
  x_m: Float32Array;
  y_m: Float32Array;
  height_m: Float32Array;
  vx_m_s: Float32Array;
  vy_m_s: Float32Array;
  vup_m_s: Float32Array;
  heading_deg: Float32Array;
  setpoint_x_m_s: Float32Array;
  setpoint_y_m_s: Float32Array;
  setpoint_up_m_s: Float32Array;
  /** 0 to 1. */
  battery: Float32Array;
  position_age_s: Float32Array;
  heartbeat_age_s: Float32Array;
  uncertainty_m: Float32Array;
  /** 0 to 1. */
  link_quality: Float32Array;
  /** Until the low-battery threshold, and until empty. */
  low_s: Float32Array;
  empty_s: Float32Array;
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

export type Right = "watch" | "operate" | "emergency";

export interface Access {
  who: string;
  rights: ReadonlySet<Right>;
}

export interface Connection {
  /** denied: the service asks for a token, or for another one. */
  kind: "connecting" | "live" | "lost" | "denied";
  /** The page's clock. */
  since_ms: number;
  /** Empty while all is well. */
  reason: string;
}

/** The last minutes, one row for every `HISTORY_STEP_S`; oldest first. */
export interface History {
  time_s: Float64Array;
  tick_p99_ms: Float64Array;
  minimumSeparation_m: Float64Array;
  radiusError_m: Float64Array;
  energy: Float64Array;
}

/** What is being dragged or typed, not yet confirmed. */
export type Ghost =
  | { kind: "target"; x_m: number; y_m: number }
  | { kind: "obstacle"; id: string; x_m: number; y_m: number }
  | { kind: "radius"; radius_m: number }
  | { kind: "new-obstacle"; x_m: number; y_m: number; half_length_x_m: number; half_length_y_m: number; height_m: number };

export interface Toast {
  id: number;
  /** grave: done, and nothing to be glad of. */
  kind: "done" | "grave" | "refused";
  text: string;
  until_ms: number;
}

export type Camera = "orbit" | "top" | "side" | "follow";
/** How the page looks, and which vehicles are selected. The message `select` alone changes the selection. */
export interface View extends Selection {
  camera: Camera;
  /** How often it was asked that everything is in the picture. */
  fits: number;
  night: boolean;
}

export interface Kill {
  armed: KillArmed;
  /** The page's clock; afterwards the code is none. */
  until_ms: number;
}

export interface State {
  /** The page's clock at the newest message `tick`. */
  page_ms: number;
  connection: Connection;
  access: Access | null;
  status: Status | null;
  frame: Frame | null;
  /** The one before `frame`: the scene interpolates between them. */
  previous: Frame | null;
  history: History;
  orders: readonly Order[];
  preflight: PreflightReport | null;
  /** Phases, cues, events and idle time of the record that is replayed, once they were read. */
  marks: ReplayMarks | null;
  /** What the record that is replayed kept and broke, once it was judged. */
  certificate: CertificateReport | null;
  toasts: readonly Toast[];
  toastsMade: number;
  view: View;
  ghost: Ghost | null;
  kill: Kill | null;
  attention: Attention;
  /** What the desk alone remembers. */
  desk: DeskState;
}

/** Without a frame for so long, nothing that is shown is fresh. */
export const STALE_MS = 1000;
export const HISTORY_STEP_S = 0.5;
export const HISTORY_ROWS = 600;
export const TOAST_MS = 6000;

const NO_HISTORY: History = {
  time_s: new Float64Array(),
  tick_p99_ms: new Float64Array(),
  minimumSeparation_m: new Float64Array(),
  radiusError_m: new Float64Array(),
  energy: new Float64Array(),
};

export function initial(now_ms: number): State {
  return {
    page_ms: now_ms,
    connection: { kind: "connecting", since_ms: now_ms, reason: "" },
    access: null,
    status: null,
    frame: null,
    previous: null,
    history: NO_HISTORY,
    orders: [],
    preflight: null,
    marks: null,
    certificate: null,
    toasts: [],
    toastsMade: 0,
    view: {
      camera: "orbit",
      fits: 0,
      night: true,
      ...NOTHING_SELECTED,
    },
    ghost: null,
    kill: null,
    attention: initialAttention(true),
    desk: initialDesk(),
  };
}

/** Whether what is shown is how it is now. */
export function fresh(state: State): boolean {
  const { connection, frame } = state;
  return connection.kind === "live" && frame !== null && frame.controlAlive && state.page_ms - frame.received_ms < STALE_MS;
}

export function may(state: State, right: Right): boolean {
  return state.access?.rights.has(right) ?? false;
}

/** Vehicle i's index by its name; -1 when there is none. */
export function indexOf(state: State, id: string): number {
  return state.status?.vehicles.findIndex((each) => each.id === id) ?? -1;
}
