/** The keyboard: which key does what. Flight commands need Shift, so that a key pressed by accident sends none. Pure. */

export const KEYS = {
  start: "S",
  pause: "P",
  resume: "R",
  stop: "H",
  abort: "L",
  kill: "K",
} as const;

export type FlightKey = keyof typeof KEYS;

export const CAMERA_KEYS = { o: "orbit", t: "top", s: "side", c: "follow" } as const;

/** Everything in the picture. */
export const FIT_KEY = "f";

export const PANEL_KEYS = {
  "1": "preflight",
  "2": "shows",
  "3": "shape",
  "4": "obstacles",
  "5": "fleet",
  "6": "vehicle",
  "7": "events",
  "8": "plots",
  "9": "stations",
} as const;

export type Command =
  | { kind: "flight"; action: FlightKey }
  | { kind: "camera"; camera: (typeof CAMERA_KEYS)[keyof typeof CAMERA_KEYS] }
  | { kind: "panel"; panel: (typeof PANEL_KEYS)[keyof typeof PANEL_KEYS] }
  | { kind: "night" | "fit" | "filter" | "help" | "close" | "confirm" | "play" }
  | { kind: "jump"; by_s: number };

export interface Press {
  key: string;
  shift: boolean;
  other: boolean; // ctrl, alt or meta: the browser's own
  typing: boolean; // in a field
  onControl: boolean; // a button or a link has the focus
}

/** What a key means now; null: nothing of ours. */
export function command(press: Press): Command | null {
  const { key, shift } = press;
  if (press.other) return null;
  if (key === "Escape") return { kind: "close" };
  if (press.typing) return null;
  if (shift) {
    const action = (Object.keys(KEYS) as FlightKey[]).find((each) => KEYS[each] === key.toUpperCase());
    if (action) return { kind: "flight", action };
  }
  if (key === "?") return { kind: "help" };
  if (shift) return null;
  const panel = PANEL_KEYS[key as keyof typeof PANEL_KEYS];
  if (panel) return { kind: "panel", panel };
  const camera = CAMERA_KEYS[key as keyof typeof CAMERA_KEYS];
  if (camera) return { kind: "camera", camera };
  if (key === FIT_KEY) return { kind: "fit" };
  if (key === "n") return { kind: "night" };
  if (key === "/") return { kind: "filter" };
  if (key === "Enter" && !press.onControl) return { kind: "confirm" };
  if (key === " " && !press.onControl) return { kind: "play" };
  if (key === ",") return { kind: "jump", by_s: -10 };
  if (key === ".") return { kind: "jump", by_s: 10 };
  return null;
}
