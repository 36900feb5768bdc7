// Everything that changes the page's state.

import type { AttentionMessage } from "./alarms/attentionState";
import type { DrawnMessage } from "./drawn/model";
import type { PlacingMessage } from "./placing/model";
import type { SiteMessage } from "./site/model";
import type { PanelState, Layout } from "./panels/state";
import type { Choice, Selection } from "./selection";
import type {
  Access, Features, ReportBody, Connection, Frame, Preview, KillArmed, Command, PreflightReport, FlightMarks, ShowCheck, Station, Status, StoredShow, View,
} from "./state";

export type Message =
  | { kind: "tick"; now_ms: number }
  | { kind: "connection"; connection: Connection }
  | { kind: "access"; access: Access | null }
  | { kind: "status"; status: Status }
  | { kind: "frame"; frame: Frame }
  | { kind: "command"; command: Command }
  | { kind: "commands"; commands: readonly Command[] }
  | { kind: "preflight"; report: PreflightReport | null; vehicles?: readonly string[] | null }
  | { kind: "shows"; shows: readonly StoredShow[] }
  | { kind: "check"; check: ShowCheck | null }
  | { kind: "features"; features: Features }
  | { kind: "stations"; stations: readonly Station[] }
  | { kind: "marks"; marks: FlightMarks }
  | { kind: "flightReport"; flightReport: ReportBody | null }
  | { kind: "done" | "grave" | "refused"; text: string }
  | { kind: "toast-gone"; id: number }
  | { kind: "view"; change: Partial<Omit<View, keyof Selection>> }
  | { kind: "select"; choice: Choice }
  | { kind: "preview"; preview: Preview | null }
  | { kind: "kill-armed"; armed: KillArmed }
  | { kind: "kill-over" }
  | AttentionMessage
  | DrawnMessage
  | PlacingMessage
  | SiteMessage
  | DeskMessage;

export type DeskMessage =
  | { kind: "panels"; change: Partial<PanelState> }
  | { kind: "layout"; layout: Layout }
  | { kind: "draft"; field: string; text: string }
  | { kind: "undo"; prefix: string }
  /** The service's answer to Select; `problem` is why it refused, empty when it did not. */
  | { kind: "show-selected"; name: string; hash: string; problem: string };
