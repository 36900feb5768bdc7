// The obstacle that is being typed, placed or drawn. Its form's fields are its one home; the scene shows it as a ghost. Pure.

import { parsed } from "./panels/format";
import type { Obstacle, State } from "./state";

export interface Box {
  x_m: number;
  y_m: number;
  half_length_x_m: number;
  half_length_y_m: number;
  height_m: number;
}

/** Default values of a new one. */
export const NEW_OBSTACLE: Box = { x_m: 0, y_m: 0, half_length_x_m: 2, half_length_y_m: 2, height_m: 10 };
/** Its id as long as it has none. */
export const NEW = "";

export const fieldOf = (name: keyof Box): string => `obstacle:${name}`;

/** As it stands, with what was typed or dragged; null where none is edited. What is no number does not count yet. */
export function editedBox({ panels: { editing, drafts }, status }: State): Obstacle | null {
  const known = status?.obstacles.find((each) => each.id === editing);
  if (editing === null || (editing !== NEW && known === undefined)) return null;
  const box = { id: NEW, velocity_x_m_s: 0, velocity_y_m_s: 0, ...NEW_OBSTACLE, ...known };
  for (const name of Object.keys(NEW_OBSTACLE) as (keyof Box)[]) box[name] = parsed(drafts[fieldOf(name)] ?? "") ?? box[name];
  return box;
}

/** A new one that has no place yet: a press in the scene gives it one, a drag draws it. */
export function isUnplaced({ panels: { editing, drafts } }: State): boolean {
  return editing === NEW && !(fieldOf("x_m") in drafts) && !(fieldOf("y_m") in drafts);
}
