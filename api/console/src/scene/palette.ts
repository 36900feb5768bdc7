// The scene's colours. Phases: Okabe and Ito's palette, lightened at night and darkened by day, so that people who
// are colour-blind can distinguish them; important states also have a shape of their own.

import type { Phase } from "../state";

/** Red, green, blue, 0 to 1, as the screen takes them. */
export type Rgb = readonly [number, number, number];

export interface Palette {
  night: boolean;
  skyTop: Rgb;
  skyLow: Rgb;
  ground: Rgb;
  haze: Rgb;
  line: Rgb;
  structure: Rgb;
  nose: Rgb;
  sphere: Rgb;
  target: Rgb;
  orbit: Rgb;
  obstacle: Rgb;
  fence: Rgb;
  pad: Rgb;
  preview: Rgb;
  setpoint: Rgb;
  selected: Rgb;
  limited: Rgb;
  caution: Rgb;
  danger: Rgb;
  stale: Rgb;
  phase: Readonly<Record<Phase, Rgb>>;
}

function rgb(hex: string): Rgb {
  const value = Number.parseInt(hex.slice(1), 16);
  return [(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255];
}

export const NIGHT: Palette = {
  night: true,
  skyTop: rgb("#04060a"),
  skyLow: rgb("#131a24"),
  ground: rgb("#090c11"),
  haze: rgb("#151c27"),
  line: rgb("#5b7896"),
  structure: rgb("#39424e"),
  nose: rgb("#f4efe6"),
  sphere: rgb("#6fa8d6"),
  target: rgb("#ff6f91"),
  orbit: rgb("#b68fd6"),
  obstacle: rgb("#d9803a"),
  fence: rgb("#c9564e"),
  pad: rgb("#7f8c99"),
  preview: rgb("#ffe9a8"),
  setpoint: rgb("#9fe0ff"),
  selected: rgb("#ffffff"),
  limited: rgb("#f0b429"),
  caution: rgb("#f0b429"),
  danger: rgb("#ff5a36"),
  stale: rgb("#5d636b"),
  phase: {
    offline: rgb("#50565e"),
    standby: rgb("#8d98a5"),
    takeoff: rgb("#56b4e9"),
    hold: rgb("#3b8ee0"),
    formation: rgb("#17c796"),
    return: rgb("#f0e442"),
    landing: rgb("#e69f00"),
    lost: rgb("#ff6b2b"),
    pilot: rgb("#e39ac4"),
    killed: rgb("#b3382c"),
  },
};

export const DAY: Palette = {
  night: false,
  skyTop: rgb("#b9d3e6"),
  skyLow: rgb("#eaf1f5"),
  ground: rgb("#dfe5e4"),
  haze: rgb("#eaf1f5"),
  line: rgb("#6d7f8c"),
  structure: rgb("#2c333b"),
  nose: rgb("#ffffff"),
  sphere: rgb("#2d6f9f"),
  target: rgb("#c2185b"),
  orbit: rgb("#7b4fa3"),
  obstacle: rgb("#b85c14"),
  fence: rgb("#b0332b"),
  pad: rgb("#5c6873"),
  preview: rgb("#8a5a00"),
  setpoint: rgb("#0072b2"),
  selected: rgb("#101418"),
  limited: rgb("#b57700"),
  caution: rgb("#c77f00"),
  danger: rgb("#c9300f"),
  stale: rgb("#9aa2a9"),
  phase: {
    offline: rgb("#a3aab1"),
    standby: rgb("#6b7681"),
    takeoff: rgb("#2f93cf"),
    hold: rgb("#0062a3"),
    formation: rgb("#00875f"),
    return: rgb("#b8a700"),
    landing: rgb("#c98500"),
    lost: rgb("#d55e00"),
    pilot: rgb("#b85c95"),
    killed: rgb("#7a1f17"),
  },
};

/** The colours of the phases for the page around the scene, as CSS writes them. */
export function phaseColours(night: boolean): Record<Phase, string> {
  const { phase } = night ? NIGHT : DAY;
  const css = ([red, green, blue]: Rgb): string => `rgb(${[red, green, blue].map((each) => Math.round(255 * each)).join(" ")})`;
  return Object.fromEntries(Object.entries(phase).map(([name, colour]) => [name, css(colour)])) as Record<Phase, string>;
}
