// The sounds of alarms, made by Web Audio: no file, no codec. What sounds and when: attention.ts.

import type { Severity } from "./model";

interface Tone {
  hertz: number;
  at_s: number;
  lasts_s: number;
}

/** An emergency is a fast two-tone alarm, a warning three rising tones, a caution one soft tone. */
const TONES: Record<Severity, readonly Tone[]> = {
  emergency: [0, 1, 2, 3, 4, 5].map((k) => ({ hertz: k % 2 === 0 ? 988 : 740, at_s: 0.18 * k, lasts_s: 0.16 })),
  warning: [587, 740, 880].map((hertz, k) => ({ hertz, at_s: 0.2 * k, lasts_s: 0.18 })),
  caution: [{ hertz: 523, at_s: 0, lasts_s: 0.35 }],
  information: [],
};
const LOUDNESS: Record<Severity, number> = { emergency: 0.35, warning: 0.25, caution: 0.15, information: 0 };
const EDGE_S = 0.012; // without it a tone clicks

export class Sounder {
  readonly #blocked: (isBlocked: boolean) => void;
  #context: AudioContext | null = null;

  /** `blocked` is called whenever the browser begins or ceases to play sound. */
  constructor(blocked: (isBlocked: boolean) => void) {
    this.#blocked = blocked;
  }

  /** Request sound from the browser, which allows it only after a press on the page. */
  unlock(): void {
    if (this.#context?.state === "running") return;
    if (this.#context === null) {
      this.#context = new AudioContext();
      this.#context.addEventListener("statechange", () => this.#tell());
    }
    if (this.#context.state === "suspended") void this.#context.resume().then(() => this.#tell());
    this.#tell();
  }

  play(severity: Severity): void {
    const context = this.#context;
    if (context?.state !== "running") return this.#blocked(true);
    const start_s = context.currentTime + 0.02;
    for (const { hertz, at_s, lasts_s } of TONES[severity]) {
      const oscillator = new OscillatorNode(context, { type: "triangle", frequency: hertz });
      const gain = new GainNode(context, { gain: 0 });
      const [from_s, until_s] = [start_s + at_s, start_s + at_s + lasts_s];
      gain.gain.setValueAtTime(0, from_s);
      gain.gain.linearRampToValueAtTime(LOUDNESS[severity], from_s + EDGE_S);
      gain.gain.setValueAtTime(LOUDNESS[severity], until_s - EDGE_S);
      gain.gain.linearRampToValueAtTime(0, until_s);
      oscillator.connect(gain).connect(context.destination);
      oscillator.start(from_s);
      oscillator.stop(until_s);
    }
  }

  #tell(): void {
    this.#blocked(this.#context?.state !== "running");
  }
}
