/** The focus of what vanishes goes to what opened it, or stays in that place: never to the start of the page, never to another command. */

const KEPT = 30;

/** Names of what had the focus, newest last. */
const used: string[] = [];

const named = (name: string): HTMLElement | null => document.querySelector<HTMLElement>(`[data-testid="${name}"]`);
const isSeen = (element: Element | null): element is HTMLElement => element !== null && element.isConnected && element.checkVisibility({ visibilityProperty: true });

/** What opens the sheet or the panel in which this is. */
function openerOf(element: Element): string {
  const box = element.closest<HTMLElement>('[data-testid^="sheet-"], aside[data-testid^="panel-"]')?.dataset["testid"] ?? "";
  return box.startsWith("panel-") ? `tab-${box.slice("panel-".length)}` : box.slice("sheet-".length);
}

export function watchFocus(place: HTMLElement): void {
  place.addEventListener("focusin", (event) => {
    const name = (event.target as HTMLElement).dataset["testid"];
    if (name !== undefined && name !== used.at(-1)) used.push(name);
    if (used.length > KEPT) used.shift();
  });
}

/** A panel that closes may leave what it had not sent: then Enter confirms that. */
function focusIn(around: readonly HTMLElement[], opener: string): void {
  if (document.activeElement !== null && document.activeElement !== document.body) return; // what has appeared took it
  const last = used.map(named).reverse().filter(isSeen);
  const near = around.find((each) => isSeen(each) && !each.matches(".center-low, .panels"));
  if (near === undefined) return ([named("preview-confirm"), named(opener), ...last].find(isSeen) ?? null)?.focus();
  const before = last.find((each) => near.contains(each));
  if (before !== undefined) return before.focus();
  if (!near.hasAttribute("tabindex")) near.setAttribute("tabindex", "-1");
  near.focus({ preventScroll: true });
}

/** Draw, and give back the focus that this takes away. */
export function keepingFocus(place: HTMLElement, draw: () => void): void {
  const had = document.activeElement;
  const around: HTMLElement[] = [];
  for (let each = had; each instanceof HTMLElement && each !== place && place.contains(each); each = each.parentElement) around.push(each);
  const opener = had === null ? "" : openerOf(had);
  draw();
  if (around.length > 0 && !isSeen(had)) queueMicrotask(() => focusIn(around.slice(1), opener)); // after `focused`
}
