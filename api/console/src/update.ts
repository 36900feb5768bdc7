// The one way from a state to the next. Pure: no clock, no network, no document.

import { updateAttention } from "./alarms/attention";
import { updateDrawn } from "./drawn/model";
import { whyNotOnGround } from "./panels/rights";
import { updatePlacing } from "./placing/model";
import { updateSite } from "./site/model";
import { updateDesk } from "./panels/update";
import { energy, radiusError_m } from "./formation";
import { choose, remaining } from "./selection";
import { HISTORY_ROWS, HISTORY_STEP_S, NO_HISTORY, PAST_S, TOAST_MS, type Connection, type Features, type Frame, type History, type Command, type State, type Status, type Toast } from "./state";
import type { Message } from "./messages";

export type { Message } from "./messages";

export function update(state: State, message: Message): State {
  return updateAttention(state, updateDesk(updateShared(state, message), message), message);
}

/** State that panels and scene share. */
function updateShared(state: State, message: Message): State {
  switch (message.kind) {
    case "tick":
      return onTick(state, message.now_ms);
    case "connection":
      return { ...state, connection: onConnection(state.connection, message.connection) };
    case "access":
      return { ...state, access: message.access };
    case "status":
      return onStatus(state, message.status);
    case "frame":
      return onFrame(state, message.frame);
    case "command":
      return { ...state, commands: withCommand(state.commands, message.command) };
    case "commands":
      return { ...state, commands: message.commands };
    case "preflight":
      return { ...state, preflight: message.report };
    case "stations":
      return state.status === null ? state : { ...state, status: { ...state.status, stations: [...message.stations] } };
    case "marks":
      return { ...state, marks: message.marks };
    case "flightReport":
      return { ...state, flightReport: message.flightReport };
    case "done":
    case "grave":
    case "refused":
      return withToast(state, message.kind, message.text);
    case "toast-gone":
      return { ...state, toasts: state.toasts.filter((each) => each.id !== message.id) };
    case "view":
      return { ...state, view: { ...state.view, ...message.change } };
    case "select":
      return { ...state, view: { ...state.view, ...choose(state.view, message.choice) } };
    case "preview":
      return { ...state, preview: message.preview };
    case "drawn": // and all of it comes into the picture
      return { ...state, drawn: updateDrawn(state.drawn, message, state.page_ms), view: { ...state.view, fits: state.view.fits + 1 } };
    case "drawn-plays":
    case "drawn-sought":
      return { ...state, drawn: updateDrawn(state.drawn, message, state.page_ms) };
    case "placing": {
      const placing = updatePlacing(state.placing, message, state.page_ms);
      const isOpened = placing !== null && placing.found.show !== state.placing?.found.show;
      return { ...state, placing, view: isOpened ? { ...state.view, fits: state.view.fits + 1 } : state.view };
    }
    case "placed-at":
    case "placing-busy":
      return { ...state, placing: updatePlacing(state.placing, message, state.page_ms) };
    case "site":
    case "site-edit":
    case "site-choose":
    case "site-step":
    case "site-saving":
    case "site-refused":
      return { ...state, site: updateSite(state.site, message) };
    case "features":
      return onFeatures(state, message.features);
    case "kill-armed":
      return { ...state, kill: { armed: message.armed, until_ms: state.page_ms + 1000 * message.armed.valid_s } };
    case "kill-over":
      return { ...state, kill: null };
    case "shows":
    case "check":
    case "panels":
    case "layout":
    case "draft":
    case "undo":
    case "show-selected":
    case "sound":
    case "sound-blocked":
    case "fold-alarms":
      return state;
  }
}

function onTick(state: State, now_ms: number): State {
  const toasts = state.toasts.filter((each) => each.until_ms > now_ms);
  return {
    ...state,
    page_ms: now_ms,
    drawn: updateDrawn(state.drawn, { kind: "tick" }, now_ms),
    toasts: toasts.length === state.toasts.length ? state.toasts : toasts,
    kill: state.kill !== null && state.kill.until_ms > now_ms ? state.kill : null,
  };
}

/** Lost again is lost since then. */
function onConnection(before: Connection, now: Connection): Connection {
  return before.kind === now.kind ? { ...now, since_ms: before.since_ms } : now;
}

/** Another service, or the same one restarted: nothing of the earlier state applies. */
function onStatus(state: State, status: Status): State {
  const known = new Set(status.vehicles.map((each) => each.id));
  const kept = remaining(state.view, (id) => known.has(id));
  const view = kept === state.view ? state.view : { ...state.view, ...kept };
  const isAnother = state.status !== null && state.status.began_unix_time_s !== status.began_unix_time_s;
  if (!isAnother) {
    const isDown = whyNotOnGround({ ...state, status }) === "";
    return { ...state, status, view, drawn: isDown ? state.drawn : null, placing: isDown ? state.placing : null };
  }
  const panels = { ...state.panels, shows: null, checks: {}, showsRefused: {} };
  return { ...state, status, view, panels, frame: null, previous: null, preflight: null, marks: null, drawn: null, placing: null, site: { ...state.site, stored: null }, features: null, featuresPast: [], kill: null, commands: [], history: NO_HISTORY };
}

function onFeatures(state: State, features: Features): State {
  const read_s = state.frame?.time_s ?? NaN;
  const past = state.featuresPast.filter((each) => each.read_s < read_s && each.read_s >= read_s - PAST_S);
  return { ...state, features, featuresRead_s: read_s, featuresPast: [...past, { read_s, features }] };
}

function onFrame(state: State, frame: Frame): State {
  const connection: Connection =
    state.connection.kind === "live" ? state.connection : { kind: "live", since_ms: frame.received_ms, reason: "" };
  const page_ms = Math.max(state.page_ms, frame.received_ms);
  const previous = state.frame !== null && state.frame.n === frame.n ? state.frame : null;
  return { ...state, page_ms, connection, frame, previous, history: withFrame(state.history, frame) };
}

/** A row more, where the last one is old enough. Where time went back (a replay), the rows after it are gone. */
function withFrame(history: History, frame: Frame): History {
  const kept = history.time_s.filter((time_s) => time_s <= frame.time_s).length;
  const last_s = history.time_s[kept - 1] ?? -Infinity;
  if (kept === history.time_s.length && frame.time_s - last_s < HISTORY_STEP_S) return history;
  const first = Math.max(0, kept + 1 - HISTORY_ROWS);
  const grown = (column: Float64Array, value: number): Float64Array => {
    const longer = new Float64Array(kept - first + 1);
    longer.set(column.subarray(first, kept));
    longer[kept - first] = value;
    return longer;
  };
  return {
    time_s: grown(history.time_s, frame.time_s),
    tick_p99_ms: grown(history.tick_p99_ms, frame.tick.p99_ms),
    minimumSeparation_m: grown(history.minimumSeparation_m, frame.minimumSeparation_m),
    radiusError_m: grown(history.radiusError_m, radiusError_m(frame)),
    energy: grown(history.energy, energy(frame)),
  };
}

const COMMANDS_KEPT = 100;

/** Newest first. */
function withCommand(commands: readonly Command[], command: Command): readonly Command[] {
  const known = commands.some((each) => each.id === command.id);
  return known ? commands.map((each) => (each.id === command.id ? command : each)) : [command, ...commands].slice(0, COMMANDS_KEPT);
}

const TOASTS_KEPT = 5;

function withToast(state: State, kind: Toast["kind"], text: string): State {
  const toast: Toast = { id: state.toastsMade + 1, kind, text, until_ms: state.page_ms + TOAST_MS };
  return { ...state, toastsMade: toast.id, toasts: [...state.toasts, toast].slice(-TOASTS_KEPT) };
}
