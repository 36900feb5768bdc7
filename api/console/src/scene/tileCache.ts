// Which tiles are cached, which are to be requested, and when a failed one is requested again. Pure except for its
// cache; the caller passes the time.

export const HELD_MAX = 64;
const AT_ONCE = 4;
/** A failed tile is not requested again sooner. */
export const RETRY_MS = 60_000;

/** Why a tile could not be loaded. */
export interface Failure {
  reason: string;
  /** There is none: the map ends there. */
  isMissing: boolean;
}

export class TileCache<Picture> {
  readonly #held = new Map<string, Picture | null>(); // the longest unwanted first; null: it is not here yet
  readonly #asking = new Set<string>(); // and not answered yet, wanted or not
  readonly #failures = new Map<string, Failure & { at_ms: number }>(); // also of what is wanted no more
  readonly #drop: (picture: Picture) => void;

  constructor(drop: (picture: Picture) => void) {
    this.#drop = drop;
  }

  get size(): number {
    return this.#held.size;
  }

  /** The wanted tiles (at most HELD_MAX) to request now. The caller answers each with `put` or `fail`. */
  ask(desired: readonly string[], now_ms: number): string[] {
    for (const [address, { at_ms }] of this.#failures) {
      if (now_ms - at_ms >= RETRY_MS) this.#failures.delete(address);
    }
    const due: string[] = [];
    for (const address of desired) {
      if (this.#failures.has(address)) continue;
      const picture = this.#held.get(address) ?? null;
      if (picture === null && !this.#asking.has(address)) {
        if (this.#asking.size >= AT_ONCE) continue;
        this.#asking.add(address);
        due.push(address);
      }
      this.#held.delete(address); // and becomes the newest
      this.#held.set(address, picture);
    }
    for (const address of [...this.#held.keys()].slice(0, Math.max(0, this.#held.size - HELD_MAX))) {
      this.#forget(address);
    }
    return due;
  }

  /** `make` is called if it still is wanted. */
  put(address: string, make: () => Picture): void {
    this.#asking.delete(address);
    if (this.#held.get(address) === null) this.#held.set(address, make());
  }

  fail(address: string, failure: Failure, at_ms: number): void {
    this.#asking.delete(address);
    if (this.#held.get(address) === null) this.#held.delete(address);
    this.#failures.set(address, { ...failure, at_ms });
  }

  picture(address: string): Picture | null {
    return this.#held.get(address) ?? null;
  }

  failure(address: string): Failure | null {
    return this.#failures.get(address) ?? null;
  }

  clear(): void {
    for (const address of [...this.#held.keys()]) {
      this.#forget(address);
    }
  }

  #forget(address: string): void {
    const picture = this.#held.get(address) ?? null;
    this.#held.delete(address);
    if (picture !== null) this.#drop(picture);
  }
}
