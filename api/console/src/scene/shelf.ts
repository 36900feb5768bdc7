// Which pictures are held, which are to be asked for, and when again one that could not be had. Pure but for what it
// holds; time is given.

export const HELD_MAX = 64;
const AT_ONCE = 4;
/** What could not be had is not asked for again any sooner. */
export const RETRY_MS = 60_000;

/** Why a picture could not be had. */
export interface Failure {
  reason: string;
  /** There is none: the map ends there. */
  isMissing: boolean;
}

interface Held<Picture> {
  picture: Picture | null;
  failure: (Failure & { at_ms: number }) | null;
}

export class Shelf<Picture> {
  readonly #held = new Map<string, Held<Picture>>(); // the longest unwanted first
  readonly #drop: (picture: Picture) => void;
  #asked = 0; // and not answered yet

  constructor(drop: (picture: Picture) => void) {
    this.#drop = drop;
  }

  get size(): number {
    return this.#held.size;
  }

  /** Of what is wanted, HELD_MAX at most, what is to be asked for now. Each is answered by `put` or `fail`. */
  ask(wanted: readonly string[], now_ms: number): string[] {
    const due: string[] = [];
    for (const address of wanted) {
      let held = this.#held.get(address);
      const isDue = held === undefined || (held.failure !== null && now_ms - held.failure.at_ms >= RETRY_MS);
      if (isDue && this.#asked + due.length < AT_ONCE) {
        due.push(address);
        held = { picture: null, failure: null };
      }
      if (held !== undefined) {
        this.#held.delete(address); // and becomes the newest
        this.#held.set(address, held);
      }
    }
    this.#asked += due.length;
    for (const address of [...this.#held.keys()].slice(0, Math.max(0, this.#held.size - HELD_MAX))) {
      this.#forget(address);
    }
    return due;
  }

  /** `make` is called if it still is wanted. */
  put(address: string, make: () => Picture): void {
    this.#asked -= 1;
    const held = this.#held.get(address);
    if (held !== undefined && held.picture === null) {
      this.#held.set(address, { picture: make(), failure: null });
    }
  }

  fail(address: string, failure: Failure, at_ms: number): void {
    this.#asked -= 1;
    const held = this.#held.get(address);
    if (held !== undefined && held.picture === null) {
      this.#held.set(address, { picture: null, failure: { ...failure, at_ms } });
    }
  }

  picture(address: string): Picture | null {
    return this.#held.get(address)?.picture ?? null;
  }

  failure(address: string): Failure | null {
    return this.#held.get(address)?.failure ?? null;
  }

  clear(): void {
    for (const address of [...this.#held.keys()]) {
      this.#forget(address);
    }
  }

  #forget(address: string): void {
    const picture = this.#held.get(address)?.picture ?? null;
    this.#held.delete(address);
    if (picture !== null) this.#drop(picture);
  }
}
