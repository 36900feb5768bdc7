// When which frame is shown. The scene runs about one frame period behind what arrived, so that there are always
// two frames to interpolate; after the newest it extrapolates with the velocities for a moment, and then stops.

import type { Frame } from "../state";
import { turn_rad, type Vec3 } from "./axes";

/** Longest extrapolation of late data: old data must never look fresh. */
export const CARRIED_ON_MS = 200;

const BEHIND = 1.1; // periods
const KEPT = 5; // frames
const SHORTEST_MS = 20;
const LONGEST_MS = 400;
const LOST_BEAT_MS = 250; // farther from the beat than this: start again
const FOLLOW = 0.2; // how fast the beat follows arrivals
const FOLLOW_PERIOD = 0.1;
/** Two frames of one run are no farther apart in recorded time: live 0.1 s, a replay at 10 times its speed about 1 s. */
export const STEP_MAX_S = 2;
const CLOCK_BACK_S = 0.05; // a clock that is being set may step back by so much

/** Between which frames, how far, and how long the newest velocities carry on. */
export interface Moment {
  from: Frame;
  to: Frame;
  /** 0: as `from`, 1: as `to`. */
  share: number;
  /** In the service's time, after `to`. */
  beyond_s: number;
  /** Nothing moves until another frame arrives. */
  still: boolean;
  /** Counts the breaks: what was seen before the last one (a scrub, a restart, silence) is not joined to what follows. */
  run: number;
}

interface FrameFilter {
  frame: Frame;
  /** The page's clock, freed from the jitter of the network. */
  at_ms: number;
}

/** A short memory of frames, each with the time when it is due. The caller passes the time. */
export class Playback {
  #shown: FrameFilter[] = [];
  #period_ms = 100;
  #run = 0;

  /** Take the newest frame; the same one again changes nothing. */
  push(frame: Frame): void {
    const last = this.#shown.at(-1);
    if (last === undefined || !continues(last.frame, frame)) {
      this.#shown = [{ frame, at_ms: frame.received_ms }];
      this.#run += 1;
      return;
    }
    if (last.frame === frame) {
      return;
    }
    const interval_ms = Math.min(LONGEST_MS, Math.max(SHORTEST_MS, frame.received_ms - last.frame.received_ms));
    this.#period_ms += FOLLOW_PERIOD * (interval_ms - this.#period_ms);
    const expected_ms = last.at_ms + this.#period_ms;
    const off_ms = frame.received_ms - expected_ms;
    const at_ms = Math.abs(off_ms) > LOST_BEAT_MS ? frame.received_ms : expected_ms + FOLLOW * off_ms;
    this.#shown.push({ frame, at_ms: Math.max(at_ms, last.at_ms + 1) });
    this.#shown.splice(0, this.#shown.length - KEPT);
  }

  /** What to show now; null before the first frame. */
  at(now_ms: number): Moment | null {
    const newest = this.#shown.at(-1);
    if (newest === undefined) {
      return null;
    }
    const due_ms = now_ms - BEHIND * this.#period_ms;
    for (let k = this.#shown.length - 1; k > 0; k -= 1) {
      const later = this.#shown[k]!;
      const earlier = this.#shown[k - 1]!;
      if (due_ms >= later.at_ms) {
        return this.#carriedOn(later, earlier, due_ms);
      }
      if (due_ms >= earlier.at_ms) {
        const share = (due_ms - earlier.at_ms) / (later.at_ms - earlier.at_ms);
        return { from: earlier.frame, to: later.frame, share, beyond_s: 0, still: false, run: this.#run };
      }
    }
    const oldest = this.#shown[0]!;
    return { from: oldest.frame, to: oldest.frame, share: 1, beyond_s: 0, still: this.#shown.length === 1, run: this.#run };
  }

  #carriedOn(newest: FrameFilter, before: FrameFilter, due_ms: number): Moment {
    const since_ms = due_ms - newest.at_ms;
    const pace = Math.max(0, recorded_s(before.frame, newest.frame) / (newest.at_ms - before.at_ms)); // of a replay
    const beyond_s = pace * Math.min(CARRIED_ON_MS, since_ms);
    return { from: newest.frame, to: newest.frame, share: 1, beyond_s, still: since_ms >= CARRIED_ON_MS, run: this.#run };
  }
}

/** Whether one frame follows the other without a break: same vehicles, and recorded time advances by no more than a step. */
function continues(last: Frame, next: Frame): boolean {
  const passed_s = recorded_s(last, next);
  const isSame = last.n === next.n && last.revision <= next.revision && next.time_s >= last.time_s;
  return last === next || (isSame && passed_s >= -CLOCK_BACK_S && passed_s <= STEP_MAX_S);
}

/** How much later it was recorded: in a replay the service's own clock always advances. */
function recorded_s(from: Frame, to: Frame): number {
  return to.unix_time_s - from.unix_time_s;
}

/** Where every vehicle is shown: three's axes, NaN unknown. Owns its arrays, which are as long as the largest fleet yet. */
export class Poses {
  n = 0;
  /** See `Moment.run`. */
  run = 0;
  /** The service's clock. */
  time_s = 0;
  /** Unix time of what is shown: in a replay, when it was recorded. */
  unix_time_s = 0;
  /** x, y, z and turn of each. */
  place = new Float32Array(0);
  center: [number, number, number] | null = null;

  /** Take the poses of a moment. */
  set(moment: Moment, originHeading_deg: number): void {
    const { from, to, share, beyond_s } = moment;
    this.n = to.n;
    this.run = moment.run;
    this.time_s = from.time_s + share * (to.time_s - from.time_s) + beyond_s;
    this.unix_time_s = from.unix_time_s + share * (to.unix_time_s - from.unix_time_s) + beyond_s;
    if (this.place.length < 4 * to.n) {
      this.place = new Float32Array(4 * to.n);
    }
    const place = this.place;
    for (let i = 0; i < to.n; i += 1) {
      place[4 * i] = mixed(from.y_m[i]!, to.y_m[i]!, share) + carried(to.vy_m_s[i]!, beyond_s);
      place[4 * i + 1] = mixed(from.height_m[i]!, to.height_m[i]!, share) + carried(to.vup_m_s[i]!, beyond_s);
      place[4 * i + 2] = -mixed(from.x_m[i]!, to.x_m[i]!, share) - carried(to.vx_m_s[i]!, beyond_s);
      place[4 * i + 3] = turned_rad(from.heading_deg[i]!, to.heading_deg[i]!, share, originHeading_deg);
    }
    this.center = centerOf(moment);
  }

  known(i: number): boolean {
    return Number.isFinite(this.place[4 * i]! + this.place[4 * i + 1]! + this.place[4 * i + 2]!);
  }
}

export function placeOf(poses: Poses, i: number): Vec3 {
  return [poses.place[4 * i]!, poses.place[4 * i + 1]!, poses.place[4 * i + 2]!];
}

const LEAP_M = 25; // farther than any vehicle flies in one frame

function mixed(from: number, to: number, share: number): number {
  return Math.abs(to - from) < LEAP_M ? from + share * (to - from) : to; // also where `from` is NaN
}

function carried(velocity_m_s: number, beyond_s: number): number {
  return beyond_s > 0 && Number.isFinite(velocity_m_s) ? velocity_m_s * beyond_s : 0;
}

/** The shorter way round; an unknown heading looks ahead. */
function turned_rad(from_deg: number, to_deg: number, share: number, origin_deg: number): number {
  const turn_deg = to_deg - from_deg - 360 * Math.round((to_deg - from_deg) / 360);
  const heading_deg = Number.isFinite(turn_deg) ? from_deg + share * turn_deg : to_deg;
  return Number.isFinite(heading_deg) ? turn_rad(heading_deg, origin_deg) : 0;
}

function centerOf({ from, to, share }: Moment): [number, number, number] | null {
  if (to.center_m === null) {
    return null;
  }
  const a = from.center_m ?? to.center_m;
  const b = to.center_m;
  return [mixed(a[1], b[1], share), mixed(a[2], b[2], share), -mixed(a[0], b[0], share)];
}
