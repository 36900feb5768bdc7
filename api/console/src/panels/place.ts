/** Sets sizes and places of an element. Attributes `style` are forbidden by the page's policy; properties are not. */

import { noChange } from "lit-html";
import { AsyncDirective } from "lit-html/async-directive.js";
import { Directive, directive, PartType, type ElementPart, type PartInfo } from "lit-html/directive.js";

class Place extends Directive {
  constructor(part: PartInfo) {
    super(part);
    if (part.type !== PartType.ELEMENT) throw new Error("place() stands among an element's attributes");
  }

  render(_properties: Readonly<Record<string, string>>): typeof noChange {
    return noChange;
  }

  override update(part: ElementPart, [properties]: [Readonly<Record<string, string>>]): typeof noChange {
    const { style } = part.element as HTMLElement;
    for (const [name, value] of Object.entries(properties)) {
      if (style.getPropertyValue(name) !== value) style.setProperty(name, value);
    }
    return noChange;
  }
}

/** `<div ${place({ left: "12%" })}>` */
export const place = directive(Place);

class Focus extends Directive {
  private isDone = false;

  render(_desired: boolean): typeof noChange {
    return noChange;
  }

  override update(part: ElementPart, [desired]: [boolean]): typeof noChange {
    if (desired && !this.isDone) queueMicrotask(() => (part.element as HTMLElement).focus());
    this.isDone = true;
    return noChange;
  }
}

/** Takes the focus once, when its element appears: `<button ${focused(true)}>` */
export const focused = directive(Focus);

class Drawn extends Directive {
  render(_done: (element: Element) => void): typeof noChange {
    return noChange;
  }

  override update(part: ElementPart, [done]: [(element: Element) => void]): typeof noChange {
    queueMicrotask(() => done(part.element));
    return noChange;
  }
}

/** Calls the function each time that the view was drawn, before it is painted: `<div ${drawn((element) => ...)}>` */
export const drawn = directive(Drawn);

class Sized extends AsyncDirective {
  private observer: ResizeObserver | null = null;

  render(_changed: (element: HTMLElement) => void): typeof noChange {
    return noChange;
  }

  override update(part: ElementPart, [changed]: [(element: HTMLElement) => void]): typeof noChange {
    if (this.observer === null) {
      this.observer = new ResizeObserver(() => changed(part.element as HTMLElement));
      this.observer.observe(part.element);
    }
    return noChange;
  }

  override disconnected(): void {
    this.observer?.disconnect();
    this.observer = null;
  }
}

/** Calls the function that it was given first whenever the element's size changes: `<div ${sized((element) => ...)}>` */
export const sized = directive(Sized);
