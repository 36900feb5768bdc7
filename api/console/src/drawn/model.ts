/** A drawn show, and the preview of it: which time is shown, where vehicles and lights are then. Pure. */

import type { components } from "../schemas/schema";

type Samples = components["schemas"]["DrawnSamples"];

type Place = readonly [number, number, number];

export interface Drawing {
  show: string;
  n: number;
  /** Of the show's clock. */
  duration_s: number;
  from_s: number;
  rate_hz: number;
  /** How many times there are samples of. */
  times: number;
  /** x, y and height of each vehicle, time after time; NaN: the law leads then. */
  positions_m: Float32Array;
  /** Red, green and blue, 0 to 255. */
  colours: Uint8Array;
  cues: readonly { cue: string; at_s: number }[];
  /** The outermost places of the whole show, x, y and height: one in each direction in which a cube has a corner, an edge or a face. */
  outline: readonly Place[];
}

export interface DrawnPreview {
  drawing: Drawing;
  /** The show's time that is shown, or was at `since_ms`. */
  at_s: number;
  /** The page's clock when it began to play; null: it stands. */
  since_ms: number | null;
}

export type DrawnMessage =
  | { kind: "drawn"; drawing: Drawing | null }
  | { kind: "drawn-plays"; plays: boolean }
  | { kind: "drawn-sought"; at_s: number };

export function decoded({ show, vehicles, duration_s, from_s, rate_hz, positions_m, colours, cues }: Samples): Drawing {
  const [n, times] = [vehicles.length, positions_m.length];
  const places = new Float32Array(3 * n * times).fill(NaN);
  const shines = new Uint8Array(3 * n * times);
  positions_m.forEach((row, k) => {
    places.set(row, 3 * n * k);
    const hex = colours[k] ?? "";
    for (let at = 0; at < hex.length / 2; at += 1) shines[3 * n * k + at] = Number.parseInt(hex.slice(2 * at, 2 * at + 2), 16);
  });
  return { show, n, duration_s, from_s, rate_hz, times, positions_m: places, colours: shines, cues, outline: outlineOf(places) };
}

const WAYS: readonly Place[] = [-1, 0, 1].flatMap((x) => [-1, 0, 1].flatMap((y) => [-1, 0, 1].map((h): Place => [x, y, h]))).filter((way) => way.some(Boolean));

function outlineOf(places: Float32Array): Place[] {
  const farthest = WAYS.map(() => -Infinity);
  const found: (Place | undefined)[] = WAYS.map(() => undefined);
  for (let at = 0; at < places.length; at += 3) {
    const [x, y, h] = [places[at]!, places[at + 1]!, places[at + 2]!];
    WAYS.forEach((way, k) => {
      const far = way[0] * x + way[1] * y + way[2] * h;
      if (far > farthest[k]!) [farthest[k], found[k]] = [far, [x, y, h]];
    });
  }
  return found.filter((each) => each !== undefined);
}

/** The show's time that is shown now. */
export function shown_s({ drawing, at_s, since_ms }: DrawnPreview, now_ms: number): number {
  const played_s = since_ms === null ? 0 : Math.max(0, now_ms - since_ms) / 1000;
  return Math.min(drawing.duration_s, at_s + played_s);
}

/** What an operator or the clock does to the preview. */
export function updateDrawn(preview: DrawnPreview | null, message: DrawnMessage | { kind: "tick" }, now_ms: number): DrawnPreview | null {
  if (message.kind === "drawn") return message.drawing === null ? null : { drawing: message.drawing, at_s: 0, since_ms: null };
  if (preview === null) return null;
  const now_s = shown_s(preview, now_ms);
  const { duration_s } = preview.drawing;
  switch (message.kind) {
    case "drawn-plays":
      if (!message.plays) return { ...preview, at_s: now_s, since_ms: null };
      return { ...preview, at_s: now_s < duration_s ? now_s : 0, since_ms: now_ms };
    case "drawn-sought": {
      const at_s = Math.min(duration_s, Math.max(0, message.at_s));
      return { ...preview, at_s, since_ms: preview.since_ms === null ? null : now_ms };
    }
    case "tick":
      return preview.since_ms !== null && now_s >= duration_s ? { ...preview, at_s: duration_s, since_ms: null } : preview;
  }
}

/** The cue that is played at a time. */
export function cueAt({ cues }: Drawing, time_s: number): string {
  return cues.findLast((each) => each.at_s <= time_s)?.cue ?? "";
}

/** Between which samples a time lies, and how far. */
export function sampleAt({ from_s, rate_hz, times }: Drawing, time_s: number): { row: number; next: number; share: number } {
  const at = Math.min(times - 1, Math.max(0, (time_s - from_s) * rate_hz));
  const row = Math.floor(at);
  return { row, next: Math.min(times - 1, row + 1), share: at - row };
}

/** x, y and height of vehicle i at a time; NaN: the law leads then. */
export function placeAt(drawing: Drawing, i: number, time_s: number): [number, number, number] {
  const { row, next, share } = sampleAt(drawing, time_s);
  return [0, 1, 2].map((k) => mixed(drawing.positions_m, drawing.n, i, k, row, next, share)) as [number, number, number];
}

/** Red, green and blue of vehicle i's light at a time, 0 to 1. */
export function colourAt(drawing: Drawing, i: number, time_s: number): [number, number, number] {
  const { row, next, share } = sampleAt(drawing, time_s);
  return [0, 1, 2].map((k) => mixed(drawing.colours, drawing.n, i, k, row, next, share) / 255) as [number, number, number];
}

function mixed(of: Float32Array | Uint8Array, n: number, i: number, k: number, row: number, next: number, share: number): number {
  const from = of[3 * (n * row + i) + k]!;
  return share === 0 ? from : from + share * (of[3 * (n * next + i) + k]! - from);
}
