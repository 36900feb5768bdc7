/** The panels' part of the one update: their state follows from the same messages. Pure. */

import { panelsOf } from "../features";
import { nearest_m } from "../formation";
import { PHASES, type State } from "../state";
import type { Message } from "../messages";
import { withLayout } from "./layout";
import { reportKey } from "./preflight";
import { parseQuery } from "./query";
import { alarmsByVehicle, rowOf, sorted } from "./rows";
import { isSite } from "./stations";
import { REFUSALS_KEPT, type PanelState, type Table } from "./state";
import { steppedBack, steppedForward } from "./stepping";

/** The table is sorted at most this often: rows that jump cannot be pressed. */
const TABLE_MS = 1000;

/** Behind the update of everything else; `message` is the same. */
export function updateDesk(state: State, message: Message): State {
  switch (message.kind) {
    case "panels": {
      const opensKill = message.change.sheet === "kill" && state.panels.sheet !== "kill";
      const next = changed(state, opensKill ? { ...message.change, killNamed: new Set(state.view.selection) } : message.change);
      if (message.change.sheet === "start" && state.panels.sheet !== "start") return changed(next, steppedForward(next));
      return "filter" in message.change || "sort" in message.change ? withTable(next) : next;
    }
    case "layout":
      return changed(state, withLayout(state.panels, message.layout));
    case "draft":
      return changed(state, { drafts: { ...state.panels.drafts, [message.field]: message.text } });
    case "undo":
      return changed(state, { drafts: without(state.panels.drafts, message.prefix) });
    case "status":
      return settled(state.panels.table.command.length === 0 ? withTable(state) : state);
    case "frame":
      return message.frame.received_ms - state.panels.table.made_ms >= TABLE_MS ? withTable(state) : state;
    case "refused": {
      const refusal = { unix_time_s: state.frame?.unix_time_s ?? NaN, text: message.text };
      return changed(state, { refusals: [refusal, ...state.panels.refusals].slice(0, REFUSALS_KEPT) });
    }
    case "shows":
      return changed(state, { shows: message.shows, showsProblem: "" });
    case "check":
      return message.check === null ? state : changed(state, { checks: { ...state.panels.checks, [message.check.name]: message.check } });
    case "show-selected":
      return changed(state, { showsRefused: withRefusal(state.panels.showsRefused, message) });
    case "preflight": {
      const read = changed(state, { preflightRead_ms: state.page_ms, preflightProblem: "", preflightFor: reportKey(message.vehicles ?? null) });
      return changed(read, steppedForward(read));
    }
    case "kill-armed":
    case "kill-over":
      return changed(state, { holding_ms: null, drafts: without(state.panels.drafts, "kill-") });
    case "tick":
      return state.kill === null && state.panels.holding_ms !== null ? changed(state, { holding_ms: null }) : state;
    default:
      return state;
  }
}

function changed(state: State, change: Partial<PanelState>): State {
  return { ...state, panels: { ...state.panels, ...change } };
}

function without(drafts: PanelState["drafts"], prefix: string): PanelState["drafts"] {
  return Object.fromEntries(Object.entries(drafts).filter(([field]) => !field.startsWith(prefix)));
}

function withRefusal(
  refused: PanelState["showsRefused"], { name, hash, problem }: { name: string; hash: string; problem: string },
): PanelState["showsRefused"] {
  const { [name]: _before, ...others } = refused;
  return problem === "" ? others : { ...others, [name]: { hash, problem } };
}

/** What is open and is gone, or has no use any more, is closed. */
function settled(before: State): State {
  const isLeading = before.panels.sure === "lead" && before.status?.stations.some((each) => each.own && each.leads);
  const { right } = before.panels;
  const isFeature = right?.startsWith("feature-") && !panelsOf(before.status).some((each) => each.name === right);
  const isGonePanel = isFeature || (right === "stations" && !isSite(before.status));
  const state = changed(before, { ...steppedBack(before), ...(isGonePanel ? { right: "fleet" as const } : {}), ...(isLeading ? { sure: "" } : {}) });
  const { editing, drafts } = state.panels;
  const isGone = editing !== null && editing !== "" && !state.status?.obstacles.some((each) => each.id === editing);
  return isGone ? changed(state, { editing: null, drafts: without(drafts, "obstacle") }) : state;
}

function withTable(state: State): State {
  return changed(state, { table: madeTable(state) });
}

function madeTable(state: State): Table {
  const { status, frame, panels } = state;
  const query = parseQuery(panels.filter);
  if (!status || !frame) return { ...panels.table, problem: query.problem };
  const nearest = nearest_m(frame);
  const alarms = alarmsByVehicle(status);
  const rows = status.vehicles.slice(0, frame.n).map((_, index) => rowOf(status, frame, nearest, index, alarms));
  const phases: Record<string, number> = Object.fromEntries(PHASES.map((phase) => [phase, 0]));
  for (const row of rows) phases[row.phase] = (phases[row.phase] ?? 0) + 1;
  return {
    command: sorted(rows.filter(query.test), panels.sort).map((row) => row.index),
    nearest_m: nearest,
    phases,
    problem: query.problem,
    made_ms: frame.received_ms,
  };
}
