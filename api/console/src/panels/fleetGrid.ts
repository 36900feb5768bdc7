/** The fleet as a dense grid: a pill for each vehicle, so that a thousand are seen at once. What meets the table's filter, in its order. */

import { html, nothing, type TemplateResult } from "lit-html";
import { guard } from "lit-html/directives/guard.js";
import { choiceOf } from "../selection";
import type { Frame, State, Status } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { percent, tail } from "./format";
import { drawn } from "./place";
import { alarmsByVehicle, isLow, isStale, rowOf, type Row } from "./rows";

const ROOMY_UP_TO = 100; // vehicles: their pills have room for numbers
const PILL_LETTERS = 8;
const BOX_PX = 5; // a pointer that moved farther draws a box

/** Every vehicle that meets the filter, as the table has them in order. */
export function rowIds(state: State): string[] {
  return state.panels.table.command.flatMap((index) => state.status?.vehicles[index]?.id ?? []);
}

export const keysOf = (event: MouseEvent | KeyboardEvent): { shift: boolean; ctrl: boolean } => ({
  shift: event.shiftKey,
  ctrl: event.ctrlKey || event.metaKey,
});

/** Arrows go from vehicle to vehicle by so many places, with Shift the selection grows; Ctrl+A takes all. `show` scrolls to the new one. */
export function onListKey(actions: PanelActions, event: KeyboardEvent, steps: Readonly<Record<string, number>>, show: (next: number, id: string) => void): void {
  const state = actions.now();
  const ids = rowIds(state);
  if (event.key === "Enter" && state.view.selected !== null) actions.openPanel("vehicle");
  if (event.key === "a" && keysOf(event).ctrl) {
    event.preventDefault();
    actions.choose({ how: "only", ids });
  }
  const step = { Home: -1e9, End: 1e9, ...steps }[event.key];
  if (step === undefined || ids.length === 0) return;
  event.preventDefault();
  const next = Math.min(ids.length - 1, Math.max(0, ids.indexOf(state.view.selected ?? "") + step));
  actions.choose({ how: event.shiftKey ? "add" : "only", ids: [ids[next]!] });
  show(next, ids[next]!);
}

/** The pill in words: for a screen reader, and for the tooltip. */
export function pillText(row: Row): string {
  const battery = texts.grid.battery(percent(row.battery));
  const alarm = row.alarm === "normal" ? "" : texts.grid.alarm(texts.alarms.severities[row.alarm]);
  return [row.id, texts.fleet.phases[row.phase], battery, texts.grid.fix(row.fix), alarm, isStale(row) ? texts.fleet.stale : ""].filter(Boolean).join(", ");
}

/** `aria-selected` is not of the template: see `mark`. */
function pill(row: Row, isRoomy: boolean): TemplateResult {
  const tenths = Number.isNaN(row.battery) ? "" : `b${Math.round(10 * row.battery)}`;
  const flags = [isLow(row) && "low", row.fixIsBad && "bad-fix", isStale(row) && "old"].filter(Boolean).join(" ");
  const text = pillText(row);
  return html`<div
    class="pill form-${row.phase} ${tenths} alarm-${row.alarm} ${flags}"
    role="option"
    id="pill-${row.id}"
    data-testid="pill-${row.id}"
    data-fix=${isRoomy || row.fixIsBad ? row.fix : nothing}
    aria-label=${text}
    title=${text}
  >${tail(row.id, PILL_LETTERS)}</div>`;
}

/** Which pills are selected, once they are drawn: a choice of a thousand makes no new templates, and changes what differs alone. */
function mark(list: Element, selection: readonly string[]): void {
  const chosen = new Set(selection);
  for (const each of list.querySelectorAll("[role=option]")) {
    const isChosen = String(chosen.has(each.id.slice("pill-".length)));
    if (each.getAttribute("aria-selected") !== isChosen) each.setAttribute("aria-selected", isChosen);
  }
}

const idOf = (element: Element | null | undefined): string | null => element?.closest("[role=option]")?.id.slice("pill-".length) ?? null;

/** A box that is being drawn: where it began, and whether it is one already. */
let begun: { x: number; y: number; isBox: boolean } | null = null;

function drawBox(event: PointerEvent): void {
  const scroller = event.currentTarget as HTMLElement;
  if (begun === null || (!begun.isBox && Math.hypot(event.clientX - begun.x, event.clientY - begun.y) < BOX_PX)) return;
  if (!begun.isBox) scroller.setPointerCapture(event.pointerId);
  begun.isBox = true;
  const frame = scroller.getBoundingClientRect();
  const { style } = scroller.querySelector<HTMLElement>(".grid-box")!;
  style.left = `${Math.min(begun.x, event.clientX) - frame.left}px`;
  style.top = `${Math.min(begun.y, event.clientY) - frame.top + scroller.scrollTop}px`;
  style.width = `${Math.abs(event.clientX - begun.x)}px`;
  style.height = `${Math.abs(event.clientY - begun.y)}px`;
}

function endBox(actions: PanelActions, event: PointerEvent): void {
  const scroller = event.currentTarget as HTMLElement;
  const { width, height } = scroller.querySelector<HTMLElement>(".grid-box")!.style;
  const box = scroller.querySelector(".grid-box")!.getBoundingClientRect();
  if (begun?.isBox && event.type === "pointerup" && width !== "" && height !== "") {
    const ids = [...scroller.querySelectorAll("[role=option]")].filter((each) => {
      const { left, right, top, bottom } = each.getBoundingClientRect();
      return left < box.right && right > box.left && top < box.bottom && bottom > box.top;
    });
    const { shift, ctrl } = keysOf(event);
    actions.choose({ how: shift || ctrl ? "add" : "only", ids: ids.map((each) => idOf(each)!) });
  }
  scroller.querySelector<HTMLElement>(".grid-box")!.style.width = "0";
  if (!begun?.isBox) choosePill(actions, event);
  begun = null;
}

function choosePill(actions: PanelActions, event: PointerEvent): void {
  const id = event.type === "pointerup" ? idOf(event.target as Element) : null;
  if (id !== null) actions.choose(choiceOf(id, keysOf(event), rowIds(actions.now())));
}

export function fleetGrid(state: State, actions: PanelActions, status: Status, frame: Frame): TemplateResult {
  const { command, nearest_m } = state.panels.table;
  const { selection, selected } = state.view;
  const isRoomy = command.length <= ROOMY_UP_TO;
  const pills = (): TemplateResult[] => {
    const alarms = alarmsByVehicle(status);
    const known = command.filter((index) => index < Math.min(frame.n, status.vehicles.length));
    return known.map((index) => rowOf(status, frame, nearest_m, index, alarms)).map((row) => pill(row, isRoomy));
  };
  const columns = (list: Element): number => getComputedStyle(list).gridTemplateColumns.split(" ").length;
  const onKey = (event: KeyboardEvent): void => {
    const list = event.currentTarget as HTMLElement;
    const row = columns(list);
    const show = (_: number, id: string): void => document.getElementById(`pill-${id}`)?.scrollIntoView({ block: "nearest" });
    onListKey(actions, event, { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -row, ArrowDown: row }, show);
  };
  return html`<div
      class="pills value ${isRoomy ? "roomy" : ""}"
      role="listbox"
      tabindex="0"
      aria-multiselectable="true"
      aria-label=${texts.grid.title}
      aria-activedescendant=${selected !== null && command.some((index) => status.vehicles[index]?.id === selected) ? `pill-${selected}` : nothing}
      data-testid="fleet-grid"
      ${drawn((list) => mark(list, selection))}
      @keydown=${onKey}
      @pointerdown=${(event: PointerEvent) => {
        if (event.button === 0) begun = { x: event.clientX, y: event.clientY, isBox: false };
      }}
      @pointermove=${(event: PointerEvent) => {
        if (event.pointerType !== "touch") drawBox(event);
      }}
      @pointerup=${(event: PointerEvent) => endBox(actions, event)}
      @pointercancel=${(event: PointerEvent) => endBox(actions, event)}
    >
      ${guard([frame, status, command], pills)}
      <div class="grid-box" role="presentation"></div>
    </div>
    ${command.length === 0 ? html`<p class="empty">${texts.fleet.noMatch}</p>` : nothing}`;
}
