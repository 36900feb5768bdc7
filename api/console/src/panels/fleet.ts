/** The fleet as a table. Rows outside the screen are not drawn, so that a thousand are as quick as eight. */

import { html, nothing, type TemplateResult } from "lit-html";
import { repeat } from "lit-html/directives/repeat.js";
import { choiceOf } from "../selection";
import { PHASES, type Frame, type State, type Status } from "../state";
import { texts } from "../texts";
import type { PanelActions } from "./actions";
import { button } from "./controls";
import { fixed, percentOnly, tail, UNKNOWN } from "./format";
import { fleetGrid, keysOf, onListKey, rowIds } from "./fleetGrid";
import { selectionBar } from "./group";
import { icon, PHASE_ICON } from "./icons";
import { place, sized } from "./place";
import { hasTerm, toggled } from "./query";
import { alarmsByVehicle, isLow, isStale, rowOf, windowed, type Column, type Row } from "./rows";
import { ROW_PX } from "./state";
import { isMissingStation } from "./stations";

const ROW_LETTERS = 16;
const COLUMNS: readonly Column[] = ["id", "phase", "held", "nearest", "battery", "age", "fix", "link", "height", "mode"];
const OF_SITE: readonly Column[] = ["id", "phase", "station", ...COLUMNS.slice(2)];

/** Whether a column says which station flies each vehicle: also in a record of a site. */
const hasStations = (status: Status): boolean => status.vehicles.some((each) => each.station !== null);

/** How many vehicles have each autopilot, by name; empty where all have the same. */
export function autopilots(status: Status): [string, number][] {
  const counts = new Map<string, number>();
  for (const each of status.vehicles) counts.set(each.autopilot, (counts.get(each.autopilot) ?? 0) + 1);
  return counts.size > 1 ? [...counts].sort() : [];
}

const TERMS = [
  { term: "problem", label: texts.fleet.problem },
  { term: "limited", label: texts.fleet.limited },
  { term: "stale", label: texts.fleet.stale },
  { term: "battery<30", label: texts.fleet.low },
] as const;

function chips(state: State, actions: PanelActions): TemplateResult {
  const { filter, table } = state.panels;
  const chip = (term: string, label: string, id: string, count?: number, shape?: TemplateResult): TemplateResult =>
    html`<button
      type="button"
      class="chip"
      data-testid=${id}
      aria-pressed=${String(hasTerm(filter, term))}
      @click=${() => actions.filter(toggled(filter, term))}
    >
      ${shape ?? nothing}${label}${count === undefined ? nothing : html` <b>${count}</b>`}
    </button>`;
  return html`<div class="chips">
    ${PHASES.filter((phase) => table.phases[phase]).map((phase) =>
      chip(`phase:${phase}`, texts.fleet.phases[phase], `chip-${phase}`, table.phases[phase], icon(PHASE_ICON[phase])),
    )}
    ${(state.status?.stations ?? []).map((each) => chip(`station:${each.name.toLowerCase()}`, each.name, `chip-station-${each.name}`, each.vehicles, icon("station")))}
    ${(state.status ? autopilots(state.status) : []).map(([name, count]) => chip(`autopilot:${name}`, name, `chip-autopilot-${name}`, count))}
    ${TERMS.map((each) => chip(each.term, each.label, `chip-${each.term.replace("<", "-")}`))}
  </div>`;
}

function heading(state: State, actions: PanelActions, column: Column): TemplateResult {
  const { sort } = state.panels;
  const isSorted = sort.column === column;
  const name = texts.fleet.columns[column];
  return html`<th
    scope="col"
    class="col-${column}"
    aria-sort=${isSorted ? (sort.descending ? "descending" : "ascending") : "none"}
  >
    <button
      type="button"
      data-testid="sort-${column}"
      title=${texts.fleet.columnHelp[column]}
      aria-label=${texts.fleet.sortBy(name, texts.fleet.columnHelp[column])}
      @click=${() => actions.sort({ column, descending: isSorted && !sort.descending })}
    >
      ${column === "held" ? icon("limited") : name}${isSorted ? icon(sort.descending ? "down" : "up") : nothing}
    </button>
  </th>`;
}

function rowView(state: State, actions: PanelActions, row: Row, position: number): TemplateResult {
  const isSelected = state.view.selection.includes(row.id);
  const low = isLow(row);
  return html`<tr
    class="${isSelected ? "selected" : ""} ${!row.received ? "never" : isStale(row) ? "old" : ""}"
    aria-rowindex=${position + 2}
    data-testid="row-${row.id}"
    aria-selected=${String(isSelected)}
    @click=${(event: MouseEvent) => actions.choose(choiceOf(row.id, keysOf(event), rowIds(actions.now())))}
  >
    <th scope="row">
      <button
        type="button"
        class="row-open"
        tabindex="-1"
        data-testid="open-${row.id}"
        title=${texts.vehicle.open(row.id)}
        aria-current=${state.view.selected === row.id ? "true" : nothing}
        @click=${(event: MouseEvent) => openRow(actions, event, row.id)}
      >
        ${tail(row.id, ROW_LETTERS)}
      </button>
    </th>
    <td class="phase phase-${row.phase}">${icon(PHASE_ICON[row.phase])}<span>${row.phase === "offline" && !row.received ? texts.fleet.notReceived : texts.fleet.phases[row.phase]}</span></td>
    ${stationCell(state, row)}
    <td class="held col-held" title=${row.limitedBy || nothing}>
      ${row.limited ? html`${icon("limited")}<span class="for-readers">${texts.fleet.limited}</span>` : nothing}
    </td>
    <td class="number col-nearest">${fixed(row.nearest_m)}</td>
    <td class="number col-battery ${low ? "low" : ""}">${low ? icon("warning") : nothing}${percentOnly(row.battery)}</td>
    <td class="number col-age age">${fixed(row.age_s)}</td>
    <td class="number col-fix ${row.fixIsBad ? "low" : ""}">${row.fixIsBad ? icon("warning") : nothing}${row.fix} ${fixed(row.fix_m)}</td>
    <td class="number col-link">${percentOnly(row.link)}</td>
    <td class="number col-height">${fixed(row.height_m)}</td>
    <td class="col-mode" title=${row.autopilot}>${row.mode}</td>
  </tr>`;
}

function stationCell({ status }: State, { station }: Row): TemplateResult | typeof nothing {
  if (!status || !hasStations(status)) return nothing;
  const isMissing = isMissingStation(status, station);
  return html`<td class="col-station ${isMissing ? "low" : ""}" title=${isMissing ? texts.stations.notReceived(station) : nothing}>
    ${isMissing ? icon("warning") : nothing}<span>${station || UNKNOWN}</span>
  </td>`;
}

/** The id is a link to the vehicle's page; with a modifier it selects as the rest of its row does. */
function openRow(actions: PanelActions, event: MouseEvent, id: string): void {
  const keys = keysOf(event);
  if (keys.shift || keys.ctrl) return;
  event.stopPropagation();
  actions.select(id);
}

/** Also to those that are not drawn yet. */
function onKey(actions: PanelActions, event: KeyboardEvent): void {
  const scroller = event.currentTarget as HTMLElement;
  onListKey(actions, event, { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10 }, (next) => {
    const [top, bottom] = [next * ROW_PX, (next + 2) * ROW_PX]; // the heading covers one
    if (top < scroller.scrollTop) scroller.scrollTop = top;
    else if (bottom > scroller.scrollTop + scroller.clientHeight) scroller.scrollTop = bottom - scroller.clientHeight;
  });
}

function table(state: State, actions: PanelActions, status: Status, frame: Frame): TemplateResult {
  const { command, nearest_m } = state.panels.table;
  const shown = windowed(command.length, state.panels.scroll_px, state.panels.room_px, ROW_PX);
  const alarms = alarmsByVehicle(status);
  const rows = command
    .slice(shown.first, shown.last)
    .filter((index) => index < Math.min(frame.n, status.vehicles.length))
    .map((index, offset) => ({ row: rowOf(status, frame, nearest_m, index, alarms), position: shown.first + offset }));
  const columns = hasStations(status) ? OF_SITE : COLUMNS;
  const measured = (event: Event): void => {
    const { scrollTop, clientHeight } = event.currentTarget as HTMLElement;
    actions.set({ scroll_px: scrollTop, room_px: clientHeight });
  };
  const resized = ({ scrollTop, clientHeight }: HTMLElement): void => actions.set({ scroll_px: scrollTop, room_px: clientHeight });
  return html`<div
    class="table-scroll"
    tabindex="0"
    role="region"
    aria-label=${texts.fleet.title}
    data-testid="fleet-scroll"
    ${sized(resized)}
    @scroll=${measured}
    @focusin=${measured}
    @keydown=${(event: KeyboardEvent) => onKey(actions, event)}
  >
    <table class="fleet value ${columns === OF_SITE ? "of-site" : ""}" aria-rowcount=${command.length + 1} data-testid="fleet-table">
      <thead>
        <tr aria-rowindex="1">
          ${columns.map((column) => heading(state, actions, column))}
        </tr>
      </thead>
      <tbody>
        <tr class="spacer" aria-hidden="true"><td colspan=${columns.length} ${place({ height: `${shown.above_px}px` })}></td></tr>
        ${repeat(
          rows,
          ({ row }) => row.id,
          ({ row, position }) => rowView(state, actions, row, position),
        )}
        <tr class="spacer" aria-hidden="true"><td colspan=${columns.length} ${place({ height: `${shown.below_px}px` })}></td></tr>
      </tbody>
    </table>
    ${command.length === 0 ? html`<p class="empty">${texts.fleet.noMatch}</p>` : nothing}
  </div>`;
}

export function fleet(state: State, actions: PanelActions): TemplateResult {
  const { status, frame, panels } = state;
  return html`<div class="fleet-panel">
    <div class="filter">
      <input
        type="search"
        data-testid="filter"
        @keydown=${(event: KeyboardEvent) => {
          if (event.key === "Enter") actions.choose({ how: "only", ids: rowIds(actions.now()) });
        }}
        autocomplete="off"
        spellcheck="false"
        aria-label=${texts.fleet.filter}
        aria-invalid=${panels.table.problem ? "true" : "false"}
        placeholder=${texts.fleet.filter}
        title=${texts.fleet.filterHelp}
        .value=${panels.filter}
        @input=${(event: Event) => actions.filter((event.target as HTMLInputElement).value)}
      />
      <span class="count" data-testid="fleet-count" role="status">
        ${texts.fleet.count(panels.table.command.length, status?.vehicles.length ?? 0)}
      </span>
      ${button(actions, {
        id: "fleet-view",
        label: panels.grid ? texts.grid.toTable : texts.grid.toGrid,
        icon: panels.grid ? "fleet" : "grid",
        iconOnly: true,
        kind: "quiet",
        press: () => actions.set({ grid: !panels.grid, scroll_px: 0 }),
      })}
      ${button(actions, {
        id: "filter-select",
        label: texts.selection.selectShown(panels.table.command.length),
        kind: "quiet",
        why: panels.table.command.length > 0 ? "" : texts.fleet.noMatch,
        press: () => actions.choose({ how: "only", ids: rowIds(actions.now()) }),
      })}
      ${button(actions, {
        id: "filter-clear",
        label: texts.fleet.clear,
        kind: "quiet",
        press: () => actions.filter(""),
      })}
    </div>
    ${panels.table.problem ? html`<p class="problem" role="alert" data-testid="filter-problem">${panels.table.problem}</p>` : nothing}
    ${chips(state, actions)} ${status && frame ? (panels.grid ? fleetGrid : table)(state, actions, status, frame) : nothing} ${selectionBar(state, actions)}
  </div>`;
}
