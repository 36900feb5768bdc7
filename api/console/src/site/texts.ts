/** Words of the site's panel and of its labels in the scene. */

import type { AreaKind } from "./area";

const metres = (value_m: number): string => `${Number(value_m.toFixed(1))} m`;

export const KINDS: Record<AreaKind, string> = {
  "flight-geography": "flight geography",
  contingency: "contingency volume",
  "ground-risk": "ground risk buffer",
  audience: "audience",
  "no-fly": "no-fly",
};

export const t = {
  title: "Site",
  unread: "The site is not read yet.",
  inForce: "This service flies within it.",
  corners: (count: number): string => `${count} corners`,
  heights: (least_m: number, greatest_m: number | null): string =>
    greatest_m === null ? `from ${metres(least_m)}` : `${metres(least_m)} to ${metres(greatest_m)}`,
  /** Once where the name says the kind. */
  named: (kind: AreaKind, name: string): string => {
    const number = /^(.*?)( \d+)?$/.exec(name)!;
    const isKind = [kind, KINDS[kind]].includes(number[1]!) || number[1]!.replaceAll("-", " ") === KINDS[kind];
    return isKind ? KINDS[kind] + (number[2] ?? "") : `${KINDS[kind]} · ${name}`;
  },
  edit: "Edit",
  how: "Drag a corner in the scene, or a side's middle to add one. In the list: arrow keys move a corner by 1 m, with Shift by 10 m; Insert adds one after it, Delete removes it.",
  areas: "Areas",
  addArea: "Add area",
  added: (kind: AreaKind): string => `Add area: ${KINDS[kind]}`,
  removeArea: "Remove area",
  removed: (name: string): string => `Remove area: ${name}`,
  notAdded: {
    most: (): string => "A site has at most 12 areas.",
    another: (kind: AreaKind): string => `A site has one ${KINDS[kind]}.`,
  },
  lastArea: "A site has at least one area.",
  list: "Corners",
  corner: (number: number): string => `Corner ${number}`,
  at: (x_m: number, y_m: number): string => `x ${x_m.toFixed(1)}, y ${y_m.toFixed(1)} m`,
  x: "x",
  y: "y",
  least: "Lowest",
  greatest: "Highest",
  noLimit: "no limit",
  add: "Add corner",
  remove: "Remove corner",
  undo: "Undo",
  redo: "Redo",
  save: "Save",
  discard: "Discard",
  saving: "Storing the site…",
  unchanged: "Nothing was changed.",
  fewest: "An area has at least 3 corners.",
  most: "An area has at most 60 corners.",
  nothingToUndo: "There is nothing to undo.",
  nothingToRedo: "There is nothing to redo.",
  stored: "The site is stored. It counts from the service's next start on; until then no start is possible.",
  storedAgain: "The site is stored.",
  refused: "It is not stored:",
  another: "The file was changed meanwhile: Discard reads it anew.",
};
