/** The last minutes as curves. uPlot draws them; it is given new numbers once a second. */

import { html, noChange, type TemplateResult } from "lit-html";
import { AsyncDirective, directive } from "lit-html/async-directive.js";
import type { ElementPart } from "lit-html/directive.js";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import type { History, State } from "../state";
import { texts } from "../texts";
import { minutes, withUnit } from "./format";

const t = texts.plots;

interface Curve {
  id: string;
  title: string;
  unit: string;
  digits: number;
  values: (history: History) => Float64Array;
  fromZero: boolean;
  floor: (state: State) => number; // a line that it should stay above; NaN: none
}

const NONE = (): number => NaN;

const CURVES: readonly Curve[] = [
  { id: "separation", title: t.separation, unit: "m", digits: 1, fromZero: true, values: (h) => h.minimumSeparation_m, floor: (s) => s.status?.flight_envelope.floor_horizontal_m ?? NaN },
  { id: "radius", title: t.radius, unit: "m", digits: 2, fromZero: true, values: (h) => h.radiusError_m, floor: NONE },
  { id: "energy", title: t.energy, unit: "", digits: 3, fromZero: false, values: (h) => h.energy, floor: NONE },
  { id: "tick", title: t.tick, unit: "ms", digits: 1, fromZero: true, values: (h) => h.tick_p99_ms, floor: NONE },
];

/** Numbers as uPlot wants them: seconds before now, and null where nothing is known. Pure. */
export function columns(history: History, values: Float64Array, floor: number): (number | null)[][] {
  const last_s = history.time_s.at(-1) ?? 0;
  const known = [...values].map((value) => (Number.isFinite(value) ? value : null));
  return [
    [...history.time_s].map((time_s) => time_s - last_s),
    known,
    known.map(() => (Number.isFinite(floor) ? floor : null)),
  ];
}

const REDRAW_MS = 1000;
const HEIGHT_PX = 104;
const SHORTEST_S = 60; // a history that has just begun is not stretched: its time axis would repeat labels

class Plot extends AsyncDirective {
  private plot: uPlot | null = null;
  private drawn_ms = -Infinity;
  private night: boolean | null = null;

  render(_curve: Curve, _state: State): typeof noChange {
    return noChange;
  }

  override update(part: ElementPart, [curve, state]: [Curve, State]): typeof noChange {
    const element = part.element as HTMLElement;
    if (this.night !== state.view.night) this.disconnected();
    if (state.page_ms - this.drawn_ms < REDRAW_MS || state.history.time_s.length < 2) return noChange;
    if (!element.isConnected) return noChange; // it has no size and no colours yet
    this.drawn_ms = state.page_ms;
    this.night = state.view.night;
    const data = columns(state.history, curve.values(state.history), curve.floor(state)) as uPlot.AlignedData;
    const width = element.clientWidth || 320;
    this.plot ??= new uPlot(options(curve, width, getComputedStyle(element)), data, element);
    if (this.plot.width !== width) this.plot.setSize({ width, height: HEIGHT_PX });
    this.plot.setData(data);
    return noChange;
  }

  override disconnected(): void {
    this.plot?.destroy();
    this.plot = null;
    this.drawn_ms = -Infinity;
  }
}

const plot = directive(Plot);

function options(curve: Curve, width: number, look: CSSStyleDeclaration): uPlot.Options {
  const colour = (name: string): string => look.getPropertyValue(name).trim();
  const axis = { stroke: colour("--text-dim"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
  return {
    width,
    height: HEIGHT_PX,
    legend: { show: false },
    cursor: { show: false },
    padding: [8, 18, 0, 0],
    scales: {
      x: { time: false, range: (_plot, least) => [Math.min(least ?? 0, -SHORTEST_S), 0] },
      y: {
        range: (_plot, least, most) =>
          curve.fromZero || least == null || most == null ? [0, Math.max(1e-3, most ?? 1) * 1.1] : uPlot.rangeNum(least, most, 0.1, true),
      },
    },
    axes: [
      { ...axis, size: 22, values: (_plot, ticks) => ticks.map((each) => minutes(each)) },
      { ...axis, size: 42 },
    ],
    series: [
      {},
      { stroke: colour("--accent"), width: 1.5, points: { show: false } },
      { stroke: colour("--warning"), width: 1.5, dash: [6, 4], points: { show: false } },
    ],
  };
}

export function plots(state: State): TemplateResult {
  const { history } = state;
  return html`<div class="plots" data-testid="plots">
    ${CURVES.map((curve) => {
      const now = curve.values(history).at(-1);
      const floor = curve.floor(state);
      return html`<figure class="plot value" data-testid="plot-${curve.id}">
        <figcaption>
          <span>${curve.title}</span>
          <b>${withUnit(now, curve.unit, curve.digits)}</b>
          ${Number.isFinite(floor) ? html`<small>- - ${t.floor} ${withUnit(floor, curve.unit)}</small>` : ""}
        </figcaption>
        <div class="plot-area" role="img" aria-label="${curve.title}, ${t.now(withUnit(now, curve.unit, curve.digits))}" ${plot(curve, state)}></div>
      </figure>`;
    })}
  </div>`;
}
