// What the page remembers of sound and announcements, and the messages that change it.

import type { Severity } from "./model";

/** A sound to be played: the page plays one whenever `count` goes up. */
export interface Ring {
  count: number;
  severity: Severity;
}

export interface Attention {
  /** The operator's setting; remembered by the browser. */
  soundOn: boolean;
  /** The browser plays no sound before the page was pressed once. */
  soundBlocked: boolean;
  /** The page's clock when it began to play. */
  unblocked_ms: number;
  /** Cautions and information are folded away. */
  isFolded: boolean;
  ring: Ring;
  /** The page's clock at the newest ring. */
  rang_ms: number;
  /** Text for the screen reader, once: `urgent` interrupts it. */
  announced: { number: number; urgent: string; calm: string };
}

export function initialAttention(soundOn: boolean): Attention {
  return {
    soundOn,
    soundBlocked: true,
    unblocked_ms: -Infinity,
    isFolded: false,
    ring: { count: 0, severity: "information" },
    rang_ms: -Infinity,
    announced: { number: 0, urgent: "", calm: "" },
  };
}

export type AttentionMessage =
  | { kind: "sound"; on: boolean }
  | { kind: "sound-blocked"; isBlocked: boolean }
  | { kind: "fold-alarms"; isFolded: boolean };
