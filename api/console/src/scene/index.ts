// The scene: one call per animation frame. (Nothing is drawn yet.)

import type { Ghost, State } from "../state";

export interface Scene {
  /** Reads the state; keeps GPU objects and trails alone. */
  draw(state: State, now_ms: number): void;
  resize(width: number, height: number, pixelRatio: number): void;
  dispose(): void;
}

export interface SceneEvents {
  /** While something is dragged; null: dropped where it was. */
  ghost(ghost: Ghost | null): void;
  select(id: string | null): void;
}

export function createScene(canvas: HTMLCanvasElement, _on: SceneEvents): Scene {
  return {
    draw() {},
    resize(width, height, pixelRatio) {
      canvas.width = Math.round(width * pixelRatio);
      canvas.height = Math.round(height * pixelRatio);
    },
    dispose() {},
  };
}
