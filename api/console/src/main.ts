// Composition: the one state, what changes it, and the one loop that draws it.

import "./styles/tokens.css";
import "./styles/page.css";
import "./styles/controls.css";
import "./styles/panels.css";
import "./styles/alarms.css";
import "./styles/selection.css";
import "./styles/layout.css";

import { render } from "lit-html";

import { createActions } from "./actions";
import { createSigns } from "./alarms/signs";
import { createDeskActions } from "./panels/createActions";
import { panels } from "./panels/index";
import { keepingFocus, watchFocus } from "./panels/focus";
import { isGridSeen, watchLayout } from "./panels/layout";
import { createReader } from "./panels/reading";
import { onKey } from "./keyboard";
import { createScene } from "./scene/index";
import { phaseColours } from "./scene/palette";
import { initial, type State } from "./state";
import { texts } from "./texts";
import { update, type Message } from "./update";
import { createApi } from "./connection/rest";
import { openStream } from "./connection/stream";
import { createTiles } from "./connection/tiles";

/** Period of the panels; the effect of an operator's input is shown at once. */
const DESK_MS = 100;
/** Period of the panels and the scene with reduced motion. */
const CALM_MS = 200;
/** How often the page looks for data to request. */
const READ_MS = 500;
const TOKEN = "token";
const LOOK = "look";
const SOUND = "alarm-sound";

const canvas = document.querySelector<HTMLCanvasElement>("#view")!;
const place = document.querySelector<HTMLElement>("#panels")!;

watchFocus(place);

let state: State = initial(performance.now());
if (localStorage.getItem(LOOK) === "day") state = update(state, { kind: "view", change: { night: false } });
if (localStorage.getItem(SOUND) === "off") state = update(state, { kind: "sound", on: false });
let waiting: Message[] = [];
let isUrgent = true;
/** The scene, which may hold the page up, comes a frame after what was done to a thousand pills. */
let isGridFirst = false;
let shown: State | null = null;
let shown_ms = -Infinity;
let drawn_ms = -Infinity;

/** With reduced motion the page changes less often; a processor that draws for a graphics card has other work. */
const calm = matchMedia("(prefers-reduced-motion: reduce)");

const dispatch = (message: Message): void => void waiting.push(message);

/** The effect of an operator's input is shown with the next frame. */
const byHand = (message: Message): void => {
  isUrgent = true;
  dispatch(message);
};

const token = (): string => sessionStorage.getItem(TOKEN) ?? "";
/** A change of the connection is shown at once: old data must not look fresh. */
const stream = openStream(token, (message) => {
  if (message.kind === "connection") byHand(message);
  else dispatch(message);
  if (document.hidden) unseen();
});

function login(text: string): void {
  sessionStorage.setItem(TOKEN, text);
  stream.restart();
}

/** The newest, with what is waiting to be shown. */
function newest(): State {
  const messages = waiting;
  waiting = [];
  state = messages.reduce(update, state);
  return state;
}

const service = createActions(createApi(token), byHand, newest);
const actions = createDeskActions(service, byHand, newest, login);
const scene = createScene(
  canvas,
  {
    preview: (preview) => byHand({ kind: "preview", preview }), shape: (id, change) => actions.shapeObstacle(id, change),
    place: (place) => byHand({ kind: "placed-at", place }), site: byHand, choose: (choice) => actions.chooseInScene(choice),
    ask({ panel, sure }) {
      actions.openPanel(panel);
      actions.set({ sure });
    },
  },
  createTiles(token),
);

/** Remember the look, and give the page the scene's colours of the phases. */
function dress(night: boolean): void {
  localStorage.setItem(LOOK, night ? "night" : "day");
  for (const [phase, colour] of Object.entries(phaseColours(night))) document.documentElement.style.setProperty(`--phase-${phase}`, colour);
}

const signs = createSigns(document, (isBlocked) => byHand({ kind: "sound-blocked", isBlocked }));

/** A hidden tab is not drawn, but its title, icon and sound still report alarms. */
function unseen(): void {
  dispatch({ kind: "tick", now_ms: performance.now() });
  signs.show(newest());
}

function onFrame(now_ms: number): void {
  dispatch({ kind: "tick", now_ms: performance.now() });
  newest();
  if (isFitLate && !scene.isHeld) fit();
  const period_ms = calm.matches ? CALM_MS : DESK_MS;
  isGridFirst = isUrgent && !isGridFirst && isGridSeen(state);
  if (!isGridFirst && (!calm.matches || isUrgent || now_ms - drawn_ms >= period_ms)) {
    scene.draw(state, now_ms);
    drawn_ms = now_ms;
  }
  if (state !== shown && (isUrgent || now_ms - shown_ms >= period_ms)) {
    document.documentElement.dataset["look"] = state.view.night ? "night" : "day";
    if (state.view.night !== shown?.view.night) dress(state.view.night);
    if (state.attention.soundOn !== shown?.attention.soundOn) localStorage.setItem(SOUND, state.attention.soundOn ? "on" : "off");
    signs.show(state);
    keepingFocus(place, () => render(panels(state, actions), place));
    if (shown === null) for (const each of place.querySelectorAll("[data-room], .room-low, .alarms")) roomChanges.observe(each);
    else if (frontOf(state) !== frontOf(shown)) fit();
    if (isAlarmsFromTop(state, shown)) place.querySelector(".alarms")!.scrollTop = 0;
    shown = state;
    shown_ms = now_ms;
    isUrgent = false;
  }
  requestAnimationFrame(onFrame);
}

/** A new alarm of importance, and a list that has become shorter, are seen from the most severe alarm on. */
function isAlarmsFromTop({ attention: { announced }, panels: { allAlarms, layout } }: State, before: State | null): boolean {
  const isNew = announced !== before?.attention.announced && announced.urgent !== "";
  return isNew || allAlarms !== before?.panels.allAlarms || layout !== before.panels.layout;
}

/** What moves the room without a change of its size: another panel, another layout. */
const frontOf = ({ panels: { layout, left, right, front } }: State): string => `${layout} ${left} ${right} ${front}`;

/** Of the room's height: where the camera's buttons take more, they lie over the scene. */
const COVERED_MOST = 0.3;

let isFitLate = false;

/** The scene is drawn only in the part that the panels leave free. */
function fit(): void {
  isFitLate = scene.isHeld; // an alarm that comes during a drag takes room from the scene afterwards
  if (isFitLate) return;
  const room = place.querySelector("[data-room]")!.getBoundingClientRect();
  const [left, top] = [Math.round(room.left), Math.round(room.top)];
  const [width, height] = [Math.max(1, Math.round(room.right) - left), Math.max(1, Math.round(room.bottom) - top)];
  const { style } = canvas.parentElement!;
  style.left = `${left}px`;
  style.top = `${top}px`;
  style.width = `${width}px`;
  style.height = `${height}px`;
  const low = place.querySelector(".room-low")?.getBoundingClientRect();
  const covered_px = low === undefined || low.height === 0 ? 0 : Math.round(room.bottom - low.top);
  style.paddingBottom = `${covered_px < COVERED_MOST * height ? covered_px : 0}px`; // the formation stays above the buttons
  scene.resize(width, height, devicePixelRatio);
  scene.draw(state, performance.now()); // at once: another size has emptied the picture
}
const roomChanges = new ResizeObserver(fit);

addEventListener("resize", () => shown !== null && fit()); // also for another pixel ratio
for (const each of ["pointerdown", "pointerup", "keydown"]) addEventListener(each, () => signs.touched());
addEventListener("keydown", (event) => onKey(event, newest(), actions));
const read = createReader(service);
setInterval(() => read(newest()), READ_MS);
watchLayout((layout) => byHand({ kind: "layout", layout }));
canvas.setAttribute("role", "img");
canvas.setAttribute("aria-label", texts.shell.scene);
requestAnimationFrame(onFrame);
