// Hands on the scene: pointer, wheel and keys become turns, moves and zooms. It knows neither state nor camera.

import { rectOf, type Rect } from "./selectionBox";

/** Modifier keys; `ctrl` is also the command key of a Mac. */
export interface Keys {
  shift: boolean;
  ctrl: boolean;
}

export interface Hands {
  /** Something under the pointer is taken hold of: returns whether there is anything. */
  grab(px: number, py: number): boolean;
  drag(px: number, py: number): void;
  /** Let go. */
  drop(): void;
  click(px: number, py: number, keys: Keys): void;
  /** A box over vehicles is being dragged; null: no longer. */
  box(rect: Rect | null): void;
  /** The box was let go: its vehicles are selected, `adds` to those that are selected already. */
  boxed(rect: Rect, adds: boolean): void;
  hover(px: number, py: number): void;
  leave(): void;
  /** Shares of the screen's height. */
  turn(right: number, up: number): void;
  pan(right: number, up: number): void;
  zoom(factor: number): void;
  frame(): void;
}

const CLICK_PX = 4;
const KEY_TURN = 0.12;
const KEY_PAN = 0.08;
const KEY_ZOOM = 1.25;

type Doing = "nothing" | "waiting" | "dragging" | "turning" | "panning" | "pinching" | "boxing";

export class Controls {
  readonly #canvas: HTMLCanvasElement;
  readonly #hands: Hands;
  readonly #fingers = new Map<number, { px: number; py: number }>();
  readonly #off = new AbortController();
  #doing: Doing = "nothing";
  #holds = false;
  #began = { px: 0, py: 0 };

  constructor(canvas: HTMLCanvasElement, hands: Hands) {
    this.#canvas = canvas;
    this.#hands = hands;
    const { signal } = this.#off;
    canvas.addEventListener("pointerdown", (event) => this.#down(event), { signal });
    canvas.addEventListener("pointermove", (event) => this.#move(event), { signal });
    canvas.addEventListener("pointerup", (event) => this.#up(event), { signal });
    canvas.addEventListener("pointercancel", (event) => this.#up(event), { signal });
    canvas.addEventListener("pointerleave", () => hands.leave(), { signal });
    canvas.addEventListener("dblclick", () => hands.frame(), { signal });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { signal, passive: false });
    canvas.ownerDocument.addEventListener("keydown", (event) => this.#key(event), { signal });
  }

  /** A finger or a button is down on the scene. */
  get isHeld(): boolean {
    return this.#fingers.size > 0;
  }

  dispose(): void {
    this.#off.abort();
  }

  #down(event: PointerEvent): void {
    const at = this.#at(event);
    this.#canvas.setPointerCapture(event.pointerId);
    this.#fingers.set(event.pointerId, at);
    if (this.#fingers.size > 1) {
      this.#letGo();
      this.#hands.box(null);
      this.#doing = "pinching";
      return;
    }
    this.#began = at;
    this.#doing = "waiting";
    this.#holds = event.button === 0 && !event.shiftKey && !isCtrl(event) && this.#hands.grab(at.px, at.py);
  }

  #move(event: PointerEvent): void {
    const at = this.#at(event);
    const before = this.#fingers.get(event.pointerId);
    if (before === undefined) {
      this.#hands.hover(at.px, at.py);
      return;
    }
    if (this.#doing === "pinching") {
      this.#pinch(event.pointerId, at);
      return;
    }
    if (this.#doing === "waiting" && Math.hypot(at.px - this.#began.px, at.py - this.#began.py) > CLICK_PX) {
      const isPan = event.shiftKey || (event.buttons & 6) !== 0;
      const isBox = isCtrl(event) && (event.buttons & 1) !== 0;
      this.#doing = this.#holds ? "dragging" : isBox ? "boxing" : isPan ? "panning" : "turning";
    }
    this.#fingers.set(event.pointerId, at);
    const scale = 1 / this.#canvas.clientHeight;
    const [right, down] = [(at.px - before.px) * scale, (at.py - before.py) * scale];
    if (this.#doing === "boxing") {
      this.#hands.box(rectOf(this.#began, at));
    } else if (this.#doing === "dragging") {
      this.#hands.drag(at.px, at.py);
    } else if (this.#doing === "turning") {
      this.#hands.turn(right, -down);
    } else if (this.#doing === "panning") {
      this.#hands.pan(right, -down);
    }
  }

  #up(event: PointerEvent): void {
    const wasClick = this.#doing === "waiting" && event.type === "pointerup";
    this.#fingers.delete(event.pointerId);
    if (wasClick && event.button === 0) {
      this.#hands.click(this.#began.px, this.#began.py, { shift: event.shiftKey, ctrl: isCtrl(event) });
    } else if (this.#doing === "boxing") {
      this.#hands.box(null);
      if (event.type === "pointerup") this.#hands.boxed(rectOf(this.#began, this.#at(event)), event.shiftKey);
    }
    if (this.#fingers.size === 0) {
      this.#letGo();
      this.#doing = "nothing";
    }
  }

  #letGo(): void {
    if (this.#holds) {
      this.#holds = false;
      this.#hands.drop();
    }
  }

  /** Two fingers move, and come closer or go apart. */
  #pinch(id: number, at: { px: number; py: number }): void {
    const other = [...this.#fingers].find(([each]) => each !== id)?.[1];
    const before = this.#fingers.get(id)!;
    this.#fingers.set(id, at);
    if (other === undefined) {
      return;
    }
    const apart = (one: { px: number; py: number }): number => Math.hypot(one.px - other.px, one.py - other.py) + 1;
    this.#hands.zoom(apart(before) / apart(at));
    const scale = 0.5 / this.#canvas.clientHeight;
    this.#hands.pan((at.px - before.px) * scale, (before.py - at.py) * scale);
  }

  #wheel(event: WheelEvent): void {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    this.#hands.zoom(Math.exp(Math.max(-0.5, Math.min(0.5, event.deltaY * lines * 0.0012))));
  }

  #key(event: KeyboardEvent): void {
    const isHere = event.target === this.#canvas || event.target === this.#canvas.ownerDocument.body;
    if (!isHere || event.ctrlKey || event.altKey || event.metaKey || !this.#did(event)) {
      return;
    }
    event.preventDefault();
  }

  #did({ key, shiftKey }: KeyboardEvent): boolean {
    const way = ARROWS[key];
    if (way !== undefined && shiftKey) {
      this.#hands.pan(-way[0] * KEY_PAN, -way[1] * KEY_PAN);
    } else if (way !== undefined) {
      this.#hands.turn(-way[0] * KEY_TURN, -way[1] * KEY_TURN);
    } else if (key === "+" || key === "=") {
      this.#hands.zoom(1 / KEY_ZOOM);
    } else if (key === "-" || key === "_") {
      this.#hands.zoom(KEY_ZOOM);
    } else if (key === "Home") {
      this.#hands.frame();
    } else {
      return false;
    }
    return true;
  }

  #at(event: PointerEvent): { px: number; py: number } {
    const box = this.#canvas.getBoundingClientRect();
    return { px: event.clientX - box.left, py: event.clientY - box.top };
  }
}

function isCtrl(event: PointerEvent): boolean {
  return event.ctrlKey || event.metaKey;
}

const ARROWS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
};
