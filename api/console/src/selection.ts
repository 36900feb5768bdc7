// The selection: the vehicles that commands act on. One for the scene, the table and every panel. Pure.

export interface Selection {
  /** The vehicle chosen last, of those in `selection`: its page is shown, the camera follows it. */
  selected: string | null;
  /** Every selected vehicle, in the order in which they were chosen. */
  selection: readonly string[];
}

/** How a choice changes the selection. */
export type Choice =
  | { how: "only" | "add"; ids: readonly string[] }
  | { how: "toggle"; id: string }
  /** From the vehicle chosen last to `to`, in the order of `among` (the table's rows). */
  | { how: "range"; to: string; among: readonly string[] };

export const NOTHING_SELECTED: Selection = { selected: null, selection: [] };

export function choose(before: Selection, choice: Choice): Selection {
  switch (choice.how) {
    case "only":
      return selectionOf(choice.ids);
    case "add":
      return selectionOf([...before.selection, ...choice.ids]);
    case "toggle":
      return before.selection.includes(choice.id)
        ? selectionOf(before.selection.filter((each) => each !== choice.id))
        : selectionOf([...before.selection, choice.id]);
    case "range": {
      const from = before.selected === null ? -1 : choice.among.indexOf(before.selected);
      const to = choice.among.indexOf(choice.to);
      if (from < 0 || to < 0) return selectionOf([...before.selection, choice.to]);
      const between = choice.among.slice(Math.min(from, to), Math.max(from, to) + 1);
      return selectionOf([...before.selection, ...between.filter((each) => each !== choice.to), choice.to]);
    }
  }
}

/** Vehicles that are no longer part of the fleet are no longer selected. Returns `before` where nothing changes. */
export function remaining(before: Selection, isKnown: (id: string) => boolean): Selection {
  return before.selection.every(isKnown) ? before : selectionOf(before.selection.filter(isKnown));
}

/** Modifier keys of a press, as every list of vehicles reads them. */
export function choiceOf(id: string, keys: { shift: boolean; ctrl: boolean }, among: readonly string[]): Choice {
  if (keys.shift) return { how: "range", to: id, among };
  return keys.ctrl ? { how: "toggle", id } : { how: "only", ids: [id] };
}

function selectionOf(ids: readonly string[]): Selection {
  const unique = [...new Set([...ids].reverse())].reverse(); // a vehicle chosen again moves to the end
  return { selected: unique.at(-1) ?? null, selection: unique };
}
