/** Which of four layouts the page has, by the size of the window, and which panels it shows. Pure but for `watchLayout`. */

import type { PanelState, Layout, LeftPanel, RightPanel } from "./state";

export type { Layout, PanelSide } from "./state";

/** In em of the browser's own letter size: larger letters need the smaller layouts earlier. The first that matches counts. */
const QUERIES: readonly (readonly [Layout, string])[] = [
  ["side", "(max-height: 35em) and (min-aspect-ratio: 1/1)"],
  ["sheet", "(max-width: 62.4em), (max-height: 35em)"],
  ["single", "(max-width: 74.9em)"],
];

export function layoutOf(matches: (query: string) => boolean): Layout {
  return QUERIES.find(([, query]) => matches(query))?.[0] ?? "wide";
}

/** Calls `changed` now, and again whenever the window's size or the screen's rotation changes the layout. */
export function watchLayout(changed: (layout: Layout) => void): void {
  const lists = QUERIES.map(([, query]) => matchMedia(query));
  const tell = (): void => changed(layoutOf((query) => lists[QUERIES.findIndex(([, each]) => each === query)]!.matches));
  for (const list of lists) list.addEventListener("change", tell);
  tell();
}

/** Where a panel is a sheet over the scene, and not a column beside it. */
export function isSmall(layout: Layout): boolean {
  return layout === "sheet" || layout === "side";
}

/** Whether alarms have less than the height of the page: their rows are dense then, and a button shows all of them. */
export function isBesideAPanel(panels: Pick<PanelState, "layout" | "left" | "right" | "front">): boolean {
  const { left, right } = shownPanels(panels);
  return isSmall(panels.layout) || right !== null || (panels.layout === "single" && left !== null);
}

/** Panels that ask the service for what a record does not hold. */
export const DEAD_IN_REPLAY: ReadonlySet<string> = new Set<LeftPanel>(["preflight", "shows"]);

export function isGridSeen({ panels }: { panels: PanelState }): boolean {
  return panels.grid && shownPanels(panels).right === "fleet";
}

export interface ShownPanels {
  left: LeftPanel | null;
  right: RightPanel | null;
}

/** The wide layout shows what is open on both sides, the others only the side that was opened last. */
export function shownPanels({ layout, left, right, front }: Pick<PanelState, "layout" | "left" | "right" | "front">): ShownPanels {
  if (layout === "wide") return { left, right };
  return { left: front === "left" ? left : null, right: front === "right" ? right : null };
}

/** After rotation: a sheet starts closed, since it covers the scene; a panel beside the scene starts open. */
export function withLayout(panels: PanelState, layout: Layout): PanelState {
  if (layout === panels.layout) return panels;
  const front = !isSmall(layout) ? (panels.front ?? "right") : isSmall(panels.layout) ? panels.front : null;
  return { ...panels, layout, front, tall: false, allAlarms: false };
}
