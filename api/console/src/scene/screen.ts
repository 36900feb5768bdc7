// Where the scene is drawn, and which part of it no panel covers.

/** The canvas, and the part of it that nothing lies over: there the camera's focus is in the middle. */
export interface Screen {
  width: number;
  height: number;
  free: { left: number; top: number; width: number; height: number };
}
