// A binary message of the console's stream: docs/stream.md. A header of 128 bytes, then columns, little-endian.

import { SHOW_PHASES, type Frame, type FrameColumn, type Numbers } from "../state";

export const VERSION = 4;
export const HEADER_BYTES = 128;
const BYTES = 7;
/** Of each number of a label that there is none. */
const NO_LABEL = 255;

/** Bytes of a frame of n vehicles with so many columns of numbers. */
export const size = (n: number, floats: number): number => HEADER_BYTES + n * (4 * floats + BYTES);

/** The sender uses another format than this page. */
export class FrameError extends Error {}

/**
 * Read a frame with the columns that its status lists; they are views of `buffer`. Throws FrameError, with what is wrong, for
 * what is none.
 */
export function decode(buffer: ArrayBuffer, received_ms: number, columns: readonly FrameColumn[]): Frame {
  if (buffer.byteLength < HEADER_BYTES) {
    throw new FrameError(`a frame of ${buffer.byteLength} bytes: the header alone has ${HEADER_BYTES}`);
  }
  const header = new DataView(buffer, 0, HEADER_BYTES);
  const version = header.getUint8(0);
  if (version !== VERSION) {
    throw new FrameError(`a frame of version ${version}: this page reads ${VERSION}; load the page again`);
  }
  const n = header.getUint32(4, true);
  const expected = size(n, columns.length);
  if (buffer.byteLength !== expected) {
    throw new FrameError(`a frame of ${buffer.byteLength} bytes: with ${n} vehicles it has ${expected}`);
  }
  const showPhase = SHOW_PHASES[header.getUint8(3)];
  if (showPhase === undefined) {
    throw new FrameError(`a frame with show phase ${header.getUint8(3)}: there are ${SHOW_PHASES.length}`);
  }
  const float = (at: number): number => header.getFloat32(at, true);
  const column = (k: number): Float32Array => new Float32Array(buffer, HEADER_BYTES + 4 * n * k, n);
  const bytes = (k: number): Uint8Array => new Uint8Array(buffer, HEADER_BYTES + n * (4 * columns.length + k), n);
  const label = [44, 45, 46, 47].map((at) => header.getUint8(at));
  return {
    ...(Object.fromEntries(columns.map(({ name }, k) => [name, column(k)])) as Numbers),
    revision: header.getUint32(8, true),
    time_s: header.getFloat64(16, true),
    unix_time_s: header.getFloat64(24, true),
    received_ms,
    n,
    controlAlive: header.getUint8(1) !== 0,
    showPhase,
    center_m: header.getUint8(2) !== 0 ? [float(48), float(52), float(56)] : null,
    target_m: [float(60), float(64)],
    radius_m: float(68),
    minimumSeparation_m: float(72),
    tick: {
      rate_hz: float(76),
      count: header.getUint32(12, true),
      missed: header.getUint32(32, true),
      p50_ms: float(80),
      p99_ms: float(84),
      lateness_p99_ms: float(88),
    },
    setpointsSent: header.getUint32(36, true),
    interventions: header.getUint32(40, true),
    clock_s: float(92),
    countdown_s: float(96),
    batteryLeast: float(100),
    batteryMedian: float(104),
    assembled_s: float(108),
    home_s: float(112),
    batteryLeastRow: header.getUint32(116, true),
    label: label.includes(NO_LABEL) ? "" : label.map((part) => String(part).padStart(2, "0")).join(":"),
    behind_s: float(120),
    tempo: float(124),
    phase: bytes(0),
    mode: bytes(1),
    landed: bytes(2),
    flags: bytes(3),
    red: bytes(4),
    green: bytes(5),
    blue: bytes(6),
  };
}
