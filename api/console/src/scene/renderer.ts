// The renderer, fitted to what the machine can do: a processor that paints for a graphics card gets fewer pixels.

import { WebGLRenderer } from "three";

import type { Screen } from "./picking";

const PIXEL_RATIO_MAX = 2;
const MANY = 100;

/** Without a graphics card fewer pixels are drawn where there are many vehicles; labels and panels stay sharp. Pure. */
export function pixelRatio(software: boolean, ofScreen: number, vehicles: number): number {
  if (!software) return Math.min(PIXEL_RATIO_MAX, ofScreen);
  return vehicles > MANY ? 0.75 : 1;
}

/** Whether WebGL is done without a graphics card. */
function isSoftware(): boolean {
  const probe = document.createElement("canvas").getContext("webgl2");
  if (probe === null) {
    return false;
  }
  const names = probe.getExtension("WEBGL_debug_renderer_info");
  const name = String(probe.getParameter(names === null ? probe.RENDERER : names.UNMASKED_RENDERER_WEBGL));
  probe.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

const SOFTWARE_MS = 1000 / 30;
const EARLY_MS = 4; // the browser's own beat: rather a little early than a whole picture late

const BEAT_MS = 1000 / 60;
const LEFT_TO_GRID = 4; // times what a picture holds up

/**
 * Whether a frame is due: without a graphics card every second one is left to the panels. Beside the fleet's grid a picture
 * that held the page up for `held_ms` is followed by four times as long without one. Pure.
 */
export function isDue(software: boolean, sinceLast_ms: number, held_ms = 0): boolean {
  return !software || sinceLast_ms >= Math.max(SOFTWARE_MS, LEFT_TO_GRID * (held_ms - BEAT_MS)) - EARLY_MS;
}

export interface Fitted {
  renderer: WebGLRenderer;
  software: boolean;
  /** Of what the screen has, as much as this machine paints in time with so many vehicles. */
  pixelRatio(ofScreen: number, vehicles: number): number;
}

/** Throws: Error where the browser has no WebGL 2. */
export function createRenderer(canvas: HTMLCanvasElement): Fitted {
  const software = isSoftware();
  const renderer = new WebGLRenderer({ canvas, antialias: !software, alpha: false, powerPreference: "high-performance" });
  renderer.autoClear = true;
  renderer.sortObjects = true;
  return { renderer, software, pixelRatio: (ofScreen, vehicles) => pixelRatio(software, ofScreen, vehicles) };
}

/** The canvas, and the part that the panels leave free, given by the padding of the canvas's parent. */
export function screenOf(canvas: HTMLCanvasElement, width: number, height: number): Screen {
  const css = canvas.parentElement === null ? null : getComputedStyle(canvas.parentElement);
  const px = (text: string | undefined): number => Number.parseFloat(text ?? "") || 0;
  const [left, top] = [px(css?.paddingLeft), px(css?.paddingTop)];
  return {
    width, height,
    free: {
      left, top,
      width: Math.max(100, width - left - px(css?.paddingRight)),
      height: Math.max(100, height - top - px(css?.paddingBottom)),
    },
  };
}
