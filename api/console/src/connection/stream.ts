// The console's stream: requests the identity, opens the WebSocket, and opens it again when it is closed or silent.

import type { Access, Connection, FrameColumn, Status } from "../state";
import { texts } from "../texts";
import type { Message } from "../update";
import { decode, FrameError } from "../schemas/frame";
import type { components } from "../schemas/schema";

/** After this silence the shown data are old; with the grace and the next drawing it is less than a second. */
const SILENT_MS = 800;
/** Messages that wait to be read while the page was busy are no silence. */
const GRACE_MS = 60;
const RETRY_MIN_MS = 500;
const RETRY_MAX_MS = 5000;
const RATE_HZ = 10;
const POLICY_VIOLATION = 1008;

export interface Stream {
  /** Start again with the present token. */
  restart(): void;
  stop(): void;
}

export function openStream(token: () => string, dispatch: (message: Message) => void): Stream {
  let socket: WebSocket | null = null;
  let silence = 0;
  let retry = 0;
  let retry_ms = RETRY_MIN_MS;
  let attempt = 0;

  const tell = (kind: Connection["kind"], reason: string): void =>
    dispatch({ kind: "connection", connection: { kind, since_ms: performance.now(), reason } });

  /** Ignore the results of everything that was started. */
  function drop(): void {
    attempt++;
    clearTimeout(silence);
    clearTimeout(retry);
    socket?.close();
    socket = null;
  }

  function lose(reason: string): void {
    drop();
    tell("lost", reason);
    retry = window.setTimeout(() => void begin(), retry_ms);
    retry_ms = Math.min(2 * retry_ms, RETRY_MAX_MS);
  }

  function deny(reason: string): void {
    drop();
    dispatch({ kind: "access", access: null });
    tell("denied", reason);
  }

  function listen(): void {
    clearTimeout(silence);
    silence = window.setTimeout(() => {
      silence = window.setTimeout(() => lose(texts.lostSilent), GRACE_MS);
    }, SILENT_MS);
  }

  async function begin(): Promise<void> {
    const mine = ++attempt;
    const access = await ask(token());
    if (mine !== attempt) return;
    if (access === "unreachable") return lose(texts.lostUnreachable);
    if (access === "denied") return deny(token() === "" ? texts.deniedNone : texts.deniedWrong);
    dispatch({ kind: "access", access });
    const protocols = token() === "" ? ["gcs.v1"] : ["gcs.v1", `bearer.${token()}`];
    const url = `${location.origin.replace(/^http/, "ws")}/api/v1/stream/console?rate_hz=${RATE_HZ}`;
    const opened = new WebSocket(url, protocols);
    opened.binaryType = "arraybuffer";
    socket = opened;
    let columns: readonly FrameColumn[] = []; // the status, which lists them, is sent first
    listen();
    opened.addEventListener("message", (event: MessageEvent<string | ArrayBuffer>) => {
      if (socket !== opened) return;
      listen();
      retry_ms = RETRY_MIN_MS;
      try {
        const message = read(event.data, columns);
        if (message.kind === "status") columns = message.status.columns;
        dispatch(message);
      } catch (error) {
        if (!(error instanceof FrameError || error instanceof SyntaxError)) throw error;
        lose(texts.unreadable(error.message));
      }
    });
    opened.addEventListener("close", (event) => {
      if (socket !== opened) return;
      if (event.code === POLICY_VIOLATION) deny(event.reason);
      else lose(event.reason || texts.lostClosed);
    });
  }

  void begin();
  return {
    restart() {
      drop();
      retry_ms = RETRY_MIN_MS;
      void begin();
    },
    stop: drop,
  };
}

/** Text is a status, bytes are a frame with the columns of the newest status. Throws FrameError or SyntaxError. */
export function read(data: string | ArrayBuffer, columns: readonly FrameColumn[]): Message {
  return typeof data === "string"
    ? { kind: "status", status: JSON.parse(data) as Status }
    : { kind: "frame", frame: decode(data, performance.now(), columns) };
}

/** A browser does not report why a WebSocket was refused; this call does. */
async function ask(token: string): Promise<Access | "denied" | "unreachable"> {
  const headers = token === "" ? {} : { Authorization: `Bearer ${token}` };
  try {
    const response = await fetch("/api/v1/access", { headers, signal: AbortSignal.timeout(3000) });
    if (response.status === 401 || response.status === 403) return "denied";
    if (!response.ok) return "unreachable";
    const { name, rights } = (await response.json()) as components["schemas"]["Access"];
    return { name, rights: new Set(rights) };
  } catch (error) {
    if (error instanceof TypeError || error instanceof DOMException || error instanceof SyntaxError) return "unreachable";
    throw error;
  }
}
