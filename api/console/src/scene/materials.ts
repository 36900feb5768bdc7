// How the scene's own shaders become materials of three.js.

import { CustomBlending, DoubleSide, OneFactor, OneMinusSrcAlphaFactor, ShaderMaterial, type IUniform } from "three";

export interface Recipe {
  uniforms: Record<string, IUniform>;
  vertexShader: string;
  fragmentShader: string;
  /** Whether what stands before it hides it. */
  hidden?: boolean;
  /** Whether it hides what stands behind it. */
  hides?: boolean;
}

/** Colours come out weighted by their alpha: alpha 0 with a colour adds light, alpha 1 covers. */
export function material({ hidden = true, hides = false, ...shader }: Recipe): ShaderMaterial {
  return new ShaderMaterial({
    ...shader,
    transparent: true, // all of it, so that `renderOrder` alone says what comes after what
    depthTest: hidden,
    depthWrite: hides,
    side: DoubleSide,
    blending: CustomBlending,
    blendSrc: OneFactor,
    blendDst: OneMinusSrcAlphaFactor,
  });
}

/** Drawn in this order. */
export const ORDER = {
  backdrop: 0, farGround: 0.2, ground: 0.3, grid: 0.5, decals: 1, groundStrokes: 2, shell: 3, graticule: 4, vehicles: 5, trails: 6, boxes: 7, strokes: 8, bubbles: 9, marks: 10,
} as const;
