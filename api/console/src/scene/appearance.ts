// How each vehicle looks: its colour, how much it shines, and what is marked on it. Pure.

import { FLAG, PHASES, STALE_MS, type Frame, type Phase } from "../state";
import type { Palette, Rgb } from "./palette";

/** What is marked by a shape, not by colour alone. Bits, as the shader counts them. */
export const MARK = { limited: 1, selected: 2 } as const;
/** The form of each phase around its vehicle, as the shader counts them; the help shows them. What flies in formation, as most do, has none. */
export const FORMS: readonly Phase[] = ["formation", "standby", "offline", "takeoff", "landing", "hold", "return", "pilot", "lost", "killed"];

const ON_GROUND: ReadonlySet<Phase> = new Set(["offline", "standby", "killed"]);
const DARKEST = 0.35; // a light that is nearly off still has a colour that one can see
const FAINT = 0.3; // shine of an airborne vehicle without a light

export function phaseOf(frame: Frame, i: number): Phase {
  return PHASES[frame.phase[i]!] ?? "offline";
}

/** Whether a vehicle's position is too old to be shown as fresh. */
export function isStale(frame: Frame, i: number, isFresh: boolean): boolean {
  return !isFresh || !(frame.position_age_s[i]! <= STALE_MS / 1000);
}

/** Red, green, blue and shine of each, its marks, and its phase's form. Owns its arrays, as long as the largest fleet yet. */
export class Appearance {
  tints = new Float32Array(0);
  marks = new Float32Array(0);
  forms = new Float32Array(0);

  set(frame: Frame, palette: Palette, isFresh: boolean, selected: ReadonlySet<number>): void {
    if (this.marks.length < frame.n) {
      this.tints = new Float32Array(4 * frame.n);
      this.marks = new Float32Array(frame.n);
      this.forms = new Float32Array(frame.n);
    }
    for (let i = 0; i < frame.n; i += 1) {
      const isOld = isStale(frame, i, isFresh);
      const [color, shine] = isOld ? [palette.stale, 0] as const : litOf(frame, i, palette);
      this.tints[4 * i] = color[0];
      this.tints[4 * i + 1] = color[1];
      this.tints[4 * i + 2] = color[2];
      this.tints[4 * i + 3] = shine;
      this.marks[i] = ((frame.flags[i]! & FLAG.limited) !== 0 && !isOld ? MARK.limited : 0) + (selected.has(i) ? MARK.selected : 0);
      this.forms[i] = FORMS.indexOf(phaseOf(frame, i));
    }
  }
}

function litOf(frame: Frame, i: number, palette: Palette): readonly [Rgb, number] {
  const phase = phaseOf(frame, i);
  if ((frame.flags[i]! & FLAG.lit) === 0) {
    return [palette.phase[phase], ON_GROUND.has(phase) ? 0 : FAINT];
  }
  const [red, green, blue] = [frame.red[i]! / 255, frame.green[i]! / 255, frame.blue[i]! / 255];
  const bright = Math.max(red, green, blue);
  if (bright === 0) {
    return [[DARKEST, DARKEST, DARKEST], 0];
  }
  const scale = Math.max(DARKEST, bright) / bright;
  return [[red * scale, green * scale, blue * scale], bright];
}
