// Labels over the scene, as elements of the page: sharp at any size. Screen readers skip them; the panels have the same as text.

import { texts } from "../texts";
import type { Vec3 } from "./axes";
import type { Eye } from "./camera";
import { project } from "./picking";

export type Manner = "grid" | "name" | "selected" | "thing" | "preview" | "close" | "handle" | "handle-preview";

interface Word {
  element: HTMLElement;
  text: string;
  manner: string;
  place: string;
}

export class Overlay {
  readonly #root: HTMLElement;
  readonly #needle: SVGGElement;
  readonly #compass: HTMLElement;
  readonly #credit: HTMLElement;
  readonly #words: Word[] = [];
  #used = 0;

  constructor(parent: HTMLElement) {
    this.#root = parent.ownerDocument.createElement("div");
    this.#root.className = "scene-words";
    this.#root.setAttribute("aria-hidden", "true");
    this.#compass = parent.ownerDocument.createElement("div");
    this.#compass.className = "scene-compass";
    this.#compass.setAttribute("aria-hidden", "true");
    this.#needle = drawCompass(this.#compass);
    this.#credit = parent.ownerDocument.createElement("p");
    this.#credit.className = "scene-credit";
    this.#credit.dataset["testid"] = "map-credit";
    this.#credit.hidden = true;
    parent.append(this.#root, this.#compass, this.#credit);
  }

  begin(): void {
    this.#used = 0;
  }

  /** A word at a place of the scene; with an offset on the screen. */
  put(eye: Eye, place: Vec3, text: string, manner: Manner, off_px = 0): void {
    const seen = project(eye.basis, eye.pose, eye.screen, place);
    if (seen === null || seen.px < -80 || seen.py < -40 || seen.px > eye.screen.width + 80 || seen.py > eye.screen.height + 40) {
      return;
    }
    const word = this.#next();
    if (word.text !== text) {
      word.text = word.element.textContent = text;
    }
    if (word.manner !== manner) {
      word.manner = manner;
      word.element.className = `scene-word ${manner}`;
    }
    const at = `translate(${seen.px.toFixed(1)}px, ${(seen.py + off_px).toFixed(1)}px)`;
    if (word.place !== at) {
      word.place = word.element.style.transform = at;
    }
  }

  end(): void {
    for (const word of this.#words.slice(this.#used)) {
      if (word.place !== "") {
        word.place = "";
        word.element.style.transform = "translate(-9999px, 0)";
      }
    }
  }

  /** North is so far clockwise from the screen's top. */
  north(turn: number, eye: Eye): void {
    const { free, height } = eye.screen;
    this.#needle.setAttribute("transform", `rotate(${((turn * 180) / Math.PI).toFixed(1)})`);
    this.#compass.style.transform = `translate(${free.left + 14}px, ${height - 78}px)`;
  }

  /** Note about the map, in the lower right corner; empty: none. */
  credit(text: string, eye: Eye): void {
    if (this.#credit.textContent !== text) {
      this.#credit.textContent = text;
      this.#credit.hidden = text === "";
    }
    const { free, height } = eye.screen;
    this.#credit.style.transform = `translate(${free.left + free.width}px, ${height}px) translate(-100%, -100%)`;
  }

  #next(): Word {
    let word = this.#words[this.#used];
    if (word === undefined) {
      const element = this.#root.ownerDocument.createElement("span");
      this.#root.append(element);
      word = { element, text: "", manner: "", place: "" };
      this.#words.push(word);
    }
    this.#used += 1;
    return word;
  }

  dispose(): void {
    this.#root.remove();
    this.#compass.remove();
    this.#credit.remove();
  }
}

const SVG = "http://www.w3.org/2000/svg";

/** A needle in a ring; returns what turns. */
function drawCompass(into: HTMLElement): SVGGElement {
  const make = <Name extends keyof SVGElementTagNameMap>(name: Name, attributes: Record<string, string>): SVGElementTagNameMap[Name] => {
    const element = into.ownerDocument.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) {
      element.setAttribute(key, value);
    }
    return element;
  };
  const whole = make("svg", { viewBox: "-32 -32 64 64", width: "64", height: "64" });
  const needle = make("g", {});
  needle.append(
    make("circle", { class: "ring", r: "22" }),
    make("path", { class: "north", d: "M 0 -19 L 6 2 L 0 -2 L -6 2 Z" }),
    make("path", { class: "south", d: "M 0 19 L 6 2 L 0 -2 L -6 2 Z" }),
  );
  const letter = make("text", { class: "letter", y: "-24", "text-anchor": "middle" });
  letter.textContent = texts.scene.north;
  needle.append(letter);
  whole.append(needle);
  into.append(whole);
  return needle;
}
