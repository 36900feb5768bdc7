// The rectangle that is dragged over vehicles to select them.

export interface Rect {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

/** Between two corners, in any order. CSS pixels. */
export function rectOf(a: { px: number; py: number }, b: { px: number; py: number }): Rect {
  return { left: Math.min(a.px, b.px), top: Math.min(a.py, b.py), right: Math.max(a.px, b.px), bottom: Math.max(a.py, b.py) };
}

export class SelectionBox {
  readonly #element: HTMLElement;

  constructor(parent: HTMLElement) {
    this.#element = parent.ownerDocument.createElement("div");
    this.#element.className = "scene-box";
    this.#element.hidden = true;
    this.#element.setAttribute("aria-hidden", "true");
    parent.append(this.#element);
  }

  show(rect: Rect | null): void {
    this.#element.hidden = rect === null;
    if (rect === null) {
      return;
    }
    const { style } = this.#element;
    style.transform = `translate(${rect.left}px, ${rect.top}px)`;
    style.width = `${rect.right - rect.left}px`;
    style.height = `${rect.bottom - rect.top}px`;
  }

  dispose(): void {
    this.#element.remove();
  }
}
