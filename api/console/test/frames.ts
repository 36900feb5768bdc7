// Frames for tests, written byte by byte as docs/stream.md says: not with the page's own reader.

import { decode, HEADER_BYTES, size } from "../src/schemas/frame";
import { PHASES, type Frame, type Phase } from "../src/state";
import { COLUMNS } from "./statuses";

export interface Vehicle {
  x_m?: number;
  y_m?: number;
  height_m?: number;
  battery?: number;
  uncertainty_m?: number;
  low_s?: number;
  empty_s?: number;
  phase?: Phase;
  flags?: number;
}

export interface Written {
  version?: number;
  time_s?: number;
  unix_time_s?: number;
  controlAlive?: boolean;
  center_m?: readonly [number, number, number];
  radius_m?: number;
  p99_ms?: number;
  showPhase?: number;
  batteryLeast?: number;
  batteryMedian?: number;
  assembled_s?: number;
  home_s?: number;
  batteryLeastRow?: number;
  label?: readonly [number, number, number, number];
  behind_s?: number;
  vehicles?: readonly Vehicle[];
}

export function bytes(written: Written): ArrayBuffer {
  const vehicles = written.vehicles ?? [];
  const n = vehicles.length;
  const floats = COLUMNS.length;
  const buffer = new ArrayBuffer(size(n, floats));
  const view = new DataView(buffer);
  view.setUint8(0, written.version ?? 4);
  view.setUint8(1, written.controlAlive === false ? 0 : 1);
  view.setUint8(2, written.center_m === undefined ? 0 : 1);
  view.setUint8(3, written.showPhase ?? 5);
  view.setUint32(4, n, true);
  view.setUint32(8, 7, true);
  view.setUint32(12, 1234, true);
  view.setFloat64(16, written.time_s ?? 10, true);
  view.setFloat64(24, written.unix_time_s ?? 1_789_999_990.25 + (written.time_s ?? 10), true);
  view.setUint32(32, 3, true);
  view.setUint32(36, 4_000_000_000, true);
  view.setUint32(40, 17, true);
  (written.center_m ?? [NaN, NaN, NaN]).forEach((value, k) => view.setFloat32(48 + 4 * k, value, true));
  [1.5, -2.5, written.radius_m ?? 10, 3.25, 20, 1, written.p99_ms ?? 2, 0.5, 42.5, NaN].forEach((value, k) =>
    view.setFloat32(60 + 4 * k, value, true),
  );
  const { batteryLeast, batteryMedian, assembled_s, home_s, batteryLeastRow } = written;
  [batteryLeast, batteryMedian, assembled_s, home_s].forEach((value, k) => view.setFloat32(100 + 4 * k, value ?? NaN, true));
  view.setUint32(116, batteryLeastRow ?? 0xffffffff, true);
  (written.label ?? [255, 255, 255, 255]).forEach((value, k) => view.setUint8(44 + k, value));
  view.setFloat32(120, written.behind_s ?? NaN, true);
  view.setFloat32(124, 1, true);
  vehicles.forEach((each, i) => {
    const numbers: Partial<Record<string, unknown>> = { ...each };
    COLUMNS.forEach(({ name }, k) => view.setFloat32(HEADER_BYTES + 4 * (n * k + i), Number(numbers[name] ?? NaN), true));
    view.setUint8(HEADER_BYTES + 4 * floats * n + i, PHASES.indexOf(each.phase ?? "formation"));
    view.setUint8(HEADER_BYTES + (4 * floats + 3) * n + i, each.flags ?? 0);
  });
  return buffer;
}

export const frame = (written: Written, received_ms = 0): Frame => decode(bytes(written), received_ms, COLUMNS);
