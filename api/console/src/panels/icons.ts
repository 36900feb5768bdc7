/** Line drawings, 24 x 24: every colour comes with a shape, for people who cannot distinguish the colours. */

import { html, svg, type TemplateResult } from "lit-html";
import type { Phase } from "../state";

const PATHS = {
  start: "M7 4l13 8-13 8z",
  pause: "M7 5v14M17 5v14",
  resume: "M5 5v14M10 5l10 7-10 7z",
  home: "M3 12l9-8 9 8M6 10v10h12V10",
  land: "M12 3v12M6 10l6 6 6-6M4 21h16",
  kill: "M12 3v9M6.3 6.3a8 8 0 1 0 11.4 0",
  takeoff: "M12 19V7M6 12l6-6 6 6M4 21h16",
  hold: "M8 6v12M16 6v12",
  formation: "M12 4a8 8 0 1 0 0 16 8 8 0 0 0 0-16M12 4v16M4 12h16",
  standby: "M12 7a5 5 0 1 0 0 10 5 5 0 0 0 0-10",
  offline: "M5 12h14",
  lost: "M9 9a3 3 0 1 1 4 2.8c-1 .5-1 1.2-1 2.2M12 18v.5",
  pilot: "M12 4a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7M5 20c0-4 3-6 7-6s7 2 7 6",
  killed: "M6 6l12 12M18 6L6 18",
  check: "M4 12.5l5 5L20 6.5",
  cross: "M6 6l12 12M18 6L6 18",
  warning: "M12 4l9 16H3zM12 10v4M12 17v.5",
  emergency: "M8.3 3h7.4L21 8.3v7.4L15.7 21H8.3L3 15.7V8.3zM12 8v5M12 16v.5",
  caution: "M12 3l9 9-9 9-9-9zM12 8.5v4M12 15.5v.5",
  sound: "M4 10v4h4l5 4V6L8 10zM16 9a4 4 0 0 1 0 6M18.5 6.5a8 8 0 0 1 0 11",
  mute: "M4 10v4h4l5 4V6L8 10zM16 9.5l5 5M21 9.5l-5 5",
  info: "M12 4a8 8 0 1 0 0 16 8 8 0 0 0 0-16M12 11v5M12 8v.5",
  question: "M9 9a3 3 0 1 1 4 2.8c-1 .5-1 1.2-1 2.2M12 18v.5",
  preflight: "M5 4h14v16H5zM8 9l1.5 1.5L12 8M8 15l1.5 1.5L12 14M14 9.5h3M14 15.5h3",
  show: "M4 6h16M4 12h10M4 18h16M17 9.5v5l4-2.5z",
  shape: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18M12 12h9M3.5 9.5c4 2.5 13 2.5 17 0",
  target: "M12 5a7 7 0 1 0 0 14 7 7 0 0 0 0-14M12 1v7M12 16v7M1 12h7M16 12h7",
  obstacle: "M5 9l7-4 7 4v8l-7 4-7-4zM5 9l7 4 7-4M12 13v8",
  grid: "M4 5h4v4H4zM10 5h4v4h-4zM16 5h4v4h-4zM4 11h4v4H4zM10 11h4v4h-4zM16 11h4v4h-4zM4 17h4v2H4zM10 17h4v2h-4zM16 17h4v2h-4z",
  fleet: "M4 6h16M4 12h16M4 18h16M8 4v16",
  vehicle: "M9 9l6 6M15 9l-6 6M6.5 4.5a2.5 2.5 0 1 0 0 5 2.5 2.5 0 0 0 0-5M17.5 4.5a2.5 2.5 0 1 0 0 5 2.5 2.5 0 0 0 0-5M6.5 14.5a2.5 2.5 0 1 0 0 5 2.5 2.5 0 0 0 0-5M17.5 14.5a2.5 2.5 0 1 0 0 5 2.5 2.5 0 0 0 0-5",
  events: "M12 4a8 8 0 1 0 0 16 8 8 0 0 0 0-16M12 8v4l3 2",
  plots: "M4 4v16h16M7 15l4-5 3 3 5-7",
  night: "M19 14.5A8 8 0 0 1 9.5 5a8 8 0 1 0 9.5 9.5z",
  day: "M12 8a4 4 0 1 0 0 8 4 4 0 0 0 0-8M12 2v3M12 19v3M2 12h3M19 12h3M5 5l2 2M17 17l2 2M19 5l-2 2M7 17l-2 2",
  site: "M5 5l10-1.5L20.5 12 17 20H4zM5 5v.5M20.5 12v.5M4 20v.5",
  station: "M12 10a2 2 0 1 0 0 4 2 2 0 0 0 0-4M12 14v7M8 21h8M8 8a5.7 5.7 0 0 0 0 8M16 8a5.7 5.7 0 0 1 0 8M5 5a10 10 0 0 0 0 14M19 5a10 10 0 0 1 0 14",
  find: "M10.5 4a6.5 6.5 0 1 0 0 13 6.5 6.5 0 0 0 0-13M15.5 15.5L21 21",
  more: "M5 12v.5M12 12v.5M19 12v.5",
  limited: "M7 11V8a5 5 0 0 1 10 0v3M5 11h14v9H5z",
  up: "M6 15l6-6 6 6",
  down: "M6 9l6 6 6-6",
} as const;

export type IconName = keyof typeof PATHS;

/** The form around a vehicle in the scene, by its phase; the scene's shader draws the same. */
const FORM_PATHS: Record<Phase, string> = {
  formation: "",
  standby: "M5 19h14",
  offline: "M5 19h5M14 19h5",
  takeoff: "M5 10l7-6 7 6",
  landing: "M5 14l7 6 7-6",
  hold: "M4 6v12M20 6v12",
  return: "M4 20V10l8-7 8 7v10z",
  pilot: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18",
  lost: "M4 4l5 5M20 4l-5 5M4 20l5-5M20 20l-5-5",
  killed: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18M6 6l4 4M18 6l-4 4M6 18l4-4M18 18l-4-4",
};

export function sceneForm(phase: Phase): TemplateResult {
  return drawn(`${FORM_PATHS[phase]}M11 12h2`);
}

export function icon(name: IconName): TemplateResult {
  return drawn(PATHS[name]);
}

function drawn(path: string): TemplateResult {
  return html`<svg class="icon" viewBox="0 0 24 24" aria-hidden="true" focusable="false">
    ${svg`<path d=${path}></path>`}
  </svg>`;
}

/** The shape of a phase. */
export const PHASE_ICON: Record<Phase, IconName> = {
  offline: "offline",
  standby: "standby",
  takeoff: "takeoff",
  hold: "hold",
  formation: "formation",
  return: "home",
  landing: "land",
  lost: "lost",
  pilot: "pilot",
  killed: "killed",
};
