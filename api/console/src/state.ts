// The page's one state. Everything that is shown follows from it; `update` alone makes the next one.

import { initialDesk, type PanelState } from "./panels/state";
import { initialAttention, type Attention } from "./alarms/attentionState";
import type { DrawnPreview } from "./drawn/model";
import type { Placing } from "./placing/model";
import { NO_SITE, type SiteState } from "./site/model";
import { NOTHING_SELECTED, type Selection } from "./selection";
import { STALE_MS } from "./snapshot";
import type { Features, ReportBody, Frame, KillArmed, Command, PreflightReport, FlightMarks, Status } from "./snapshot";

export * from "./snapshot";

export type Right = "watch" | "operate" | "emergency";

export interface Access {
  name: string;
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

/** What is being dragged, not yet confirmed; of an obstacle it is in its form, see obstacle.ts. */
export type Preview =
  | { kind: "target"; x_m: number; y_m: number }
  | { kind: "radius"; radius_m: number };

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
  /** Counts the requests to fit everything into view. */
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
  commands: readonly Command[];
  preflight: PreflightReport | null;
  /** Phases, commands and alarms of the flight, or of the record that is replayed, once they were read. */
  marks: FlightMarks | null;
  /** What the record that is replayed kept and broke, once it was judged. */
  flightReport: ReportBody | null;
  toasts: readonly Toast[];
  toastsMade: number;
  view: View;
  preview: Preview | null;
  /** A drawn show that is looked at before it flies. */
  drawn: DrawnPreview | null;
  /** A drawn show that is moved and turned beside the vehicles. */
  placing: Placing | null;
  /** The areas of the site, and what is changed of them. */
  site: SiteState;
  /** What features report, as read last; null: as the status has it. */
  features: Features | null;
  /** The service's clock then. */
  featuresRead_s: number;
  /** All that was read in the last `PAST_S`, oldest first. */
  featuresPast: readonly { read_s: number; features: Features }[];
  kill: Kill | null;
  attention: Attention;
  /** State of the panels alone. */
  panels: PanelState;
}

export const HISTORY_STEP_S = 0.5;
export const HISTORY_ROWS = 600;
export const TOAST_MS = 6000;
export const PAST_S = 60;

export const NO_HISTORY: History = {
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
    commands: [],
    preflight: null,
    marks: null,
    flightReport: null,
    toasts: [],
    toastsMade: 0,
    view: {
      camera: "orbit",
      fits: 0,
      night: true,
      ...NOTHING_SELECTED,
    },
    preview: null,
    drawn: null,
    placing: null,
    site: NO_SITE,
    features: null,
    featuresRead_s: NaN,
    featuresPast: [],
    kill: null,
    attention: initialAttention(true),
    panels: initialDesk(),
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

const indices = new WeakMap<Status, ReadonlyMap<string, number>>();

/** A vehicle's index by its name; -1 when there is none. One status is asked for a thousand of them. */
export function indexOf({ status }: State, id: string): number {
  if (status === null) return -1;
  const known = indices.get(status) ?? new Map(status.vehicles.map((each, i) => [each.id, i]));
  indices.set(status, known);
  return known.get(id) ?? -1;
}
