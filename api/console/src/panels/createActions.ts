/** The panels' actions: they change the page's own state, or call the service. */

import type { Actions, DrawingFormat } from "../actions";
import type { Choice, Selection } from "../selection";
import { fieldOf, NEW_OBSTACLE, type Box } from "../obstacle";
import type { State, View } from "../state";
import { texts } from "../texts";
import type { Message } from "../messages";
import { DEAD_IN_REPLAY, isSmall, shownPanels } from "./layout";
import { typedNumbers, whyNotGroup, type Group } from "./shape";
import { HOLD_MS, type PanelState, type LeftPanel, type RightPanel } from "./state";
import { whyNotApply, whyNotPlacing } from "../placing/panel";
import { whyNotOnGround } from "./rights";
import { geojson } from "../site/model";
import { beginOrder, beginTime } from "./begin";
import { startOrder } from "./start";
import { isSite } from "./stations";
import type { PanelActions, PanelName, Remedy } from "./actions";
import { showCommand, type Alarm } from "../alarms/model";

const LEFT: readonly PanelName[] = ["preflight", "shows", "shape", "obstacles"];
const SHOW_MAX_BYTES = 64 * 1024;
const DRAWING_MAX_BYTES = 32 * 1024 * 1024;
const DRAWING = /\.(skyc|zip|csv)$/i;
const SHOW_NAME = /^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$/;

export function createDeskActions(
  service: Actions,
  dispatch: (message: Message) => void,
  state: () => State,
  login: (token: string) => void,
): PanelActions {
  const set = (change: Partial<PanelState>): void => dispatch({ kind: "panels", change });
  const undo = (prefix: string): void => dispatch({ kind: "undo", prefix });
  const view = (change: Partial<Omit<View, keyof Selection>>): void => dispatch({ kind: "view", change });
  const choose = (choice: Choice): void => dispatch({ kind: "select", choice });
  const refuse = (what: string, why: string): void => dispatch({ kind: "refused", text: texts.refused(what, why) });
  let holding = 0;

  function openPanel(name: PanelName): void {
    const { panels, status } = state();
    if (status?.replay && DEAD_IN_REPLAY.has(name)) return;
    if (name === "stations" && !isSite(status)) return;
    const sheet = isSmall(panels.layout) && panels.sheet === "start" ? null : panels.sheet; // it hides the panel
    if (LEFT.includes(name)) set({ left: name as LeftPanel, front: "left", sheet, allAlarms: false });
    else set({ right: name as RightPanel, front: "right", sheet, allAlarms: false, ...(name === "stations" ? { sure: "" } : {}) });
  }

  function releaseKill(): void {
    clearTimeout(holding);
    if (state().panels.holding_ms !== null) set({ holding_ms: null });
  }

  async function confirmKill(code: string): Promise<void> {
    if (await service.confirmKill(code.trim())) {
      dispatch({ kind: "kill-over" });
      set({ sheet: null, killNamed: new Set() });
    }
  }

  /** What a group has on the screen, with what was typed into it. */
  async function apply(group: Group): Promise<void> {
    const { status, frame, panels } = state();
    const numbers = typedNumbers(panels.drafts, group);
    const why = whyNotGroup(state(), group) || (numbers === null ? texts.shape.badNumber : "");
    if (why !== "") return refuse(texts.shape.groups[group], why);
    if (numbers === null || !status || Object.keys(numbers).length === 0) return;
    let accepted: boolean;
    switch (group) {
      case "formation":
        accepted = await service.changeFormation(numbers);
        break;
      case "orbit":
        accepted = await service.changeOrbit(numbers);
        break;
      case "yaw":
        accepted = await service.changeYaw(numbers);
        break;
      case "target": {
        const { velocity_x_m_s, velocity_y_m_s } = status.target;
        const [x_m, y_m] = frame?.target_m ?? [status.target.x_m ?? 0, status.target.y_m ?? 0];
        accepted = await service.setTarget({ x_m, y_m, velocity_x_m_s, velocity_y_m_s, ...numbers });
      }
    }
    if (accepted) undo(`${group}:`);
  }

  async function saveObstacle(): Promise<void> {
    const { editing, drafts } = state().panels;
    const numbers = typedNumbers(drafts, "obstacle") as Partial<Box> | null;
    if (editing === null) return;
    if (numbers === null) return refuse(texts.obstacles.save, texts.shape.badNumber);
    const id = drafts["obstacle-id"]?.trim() || null;
    const accepted = editing
      ? await service.changeObstacle(editing, numbers)
      : await service.addObstacle(id, { ...NEW_OBSTACLE, ...numbers });
    if (accepted) edit(null);
  }

  function edit(obstacle: string | null): void {
    undo("obstacle");
    set({ editing: obstacle, sure: "" });
  }

  async function upload(file: File): Promise<void> {
    const format = DRAWING.exec(file.name)?.[1]?.toLowerCase() as DrawingFormat | undefined;
    const name = file.name.replace(/\.ya?ml$/i, "").replace(DRAWING, "");
    const what = texts.commands.upload(name);
    if (!SHOW_NAME.test(name)) return refuse(what, texts.shows.badName);
    if (format !== undefined) return uploadDrawing(name, format, file);
    if (file.size > SHOW_MAX_BYTES) return refuse(what, texts.shows.tooLarge);
    if (await service.uploadShow(name, await file.text())) {
      await service.loadShows();
      await service.checkShow(name);
    }
  }

  async function uploadDrawing(name: string, format: DrawingFormat, file: File): Promise<void> {
    if (file.size > DRAWING_MAX_BYTES) return refuse(texts.commands.upload(name), texts.shows.drawingTooLarge);
    set({ reading: "show-upload" });
    const accepted = await service.importDrawing(name, format, file);
    set({ reading: "" });
    if (!accepted) return;
    const checked = service.checkShow(name); // takes a minute
    await service.loadShows();
    await previewShow(name);
    await checked;
  }

  async function previewShow(name: string): Promise<void> {
    const why = whyNotOnGround(state());
    if (why !== "") return refuse(texts.commands.preview(name), why);
    set({ reading: `show-preview-${name}` });
    await service.loadDrawing(name);
    set({ reading: "" });
  }

  async function placeShow(name: string): Promise<void> {
    const why = whyNotPlacing(state());
    if (why !== "") return refuse(texts.commands.place(name), why);
    set({ reading: `show-place-${name}` });
    await service.loadPlacement(name, null, false);
    set({ reading: "" });
  }

  async function applyPlacement(): Promise<void> {
    const { placing } = state();
    const why = whyNotApply(state());
    if (placing === null || why !== "") return refuse(texts.placing.apply, why);
    const { show } = placing.found;
    if (!(await service.place(show, placing.place))) return;
    const checked = service.checkShow(show, true); // takes a minute
    await service.loadShows();
    if (state().drawn?.drawing.show === show) await service.loadDrawing(show);
    await checked;
  }

  async function excluded(id: string): Promise<void> {
    if (await service.exclude(id, (state().panels.drafts["exclude-reason"] ?? "").trim())) {
      undo("exclude-reason");
      set({ excluding: null });
      await service.loadPreflight();
    }
  }

  /** The same command to vehicles one after the other, as far as it is accepted. */
  async function each(vehicles: readonly string[], command: (id: string) => Promise<boolean>): Promise<void> {
    for (const id of vehicles) if (!(await command(id))) break;
    await service.loadPreflight();
  }

  const leaveOut = (vehicles: readonly string[], why: string): Promise<void> => each(vehicles, (id) => service.exclude(id, why));
  const confirmDown = (vehicles: readonly string[]): Promise<void> => each(vehicles, (id) => service.vehicle(id, "confirm-down"));

  async function mend({ remedy, vehicles, radius_m, obstacle }: Remedy): Promise<void> {
    switch (remedy) {
      case "leave-out":
        return leaveOut(vehicles, texts.preflight.failed);
      case "confirm-down":
        return confirmDown(vehicles);
      case "set-radius":
        await service.changeFormation({ radius_m: radius_m ?? 0 });
        break;
      case "remove-obstacle":
        await service.removeObstacle(obstacle);
    }
    await service.loadPreflight();
  }

  async function follow(alarm: Alarm): Promise<void> {
    const ofShow = showCommand(alarm);
    if (ofShow !== null) return void (await service.show(ofShow));
    const { id, action, vehicles } = alarm;
    switch (action) {
      case "return":
      case "land":
      case "take-control":
        return void (await service.fleet(action, vehicles));
      case "leave-out":
        return leaveOut(vehicles, texts.preflight.silent);
      case "include":
        return each(vehicles, (one) => service.vehicle(one, "include"));
      case "confirm-down": {
        const isSure = state().panels.sure === id;
        set({ sure: isSure ? "" : id });
        if (isSure) await confirmDown(vehicles);
      }
    }
  }

  async function readReport(): Promise<void> {
    set({ reportReading: true, reportProblem: "" });
    await service.loadReport();
    set({ reportReading: false });
  }

  return {
    now: state,
    dispatch,
    view,
    set,
    draft: (field, text) => dispatch({ kind: "draft", field, text }),
    undo,
    filter: (filter) => set({ filter, scroll_px: 0 }),
    sort: (sort) => set({ sort }),
    select(id) {
      choose({ how: "only", ids: [id] });
      openPanel("vehicle");
    },
    choose,
    chooseInScene(choice) {
      choose(choice);
      const { view: { selection }, panels: { right } } = state();
      if (selection.length > 0 && right !== "fleet") openPanel("vehicle");
    },
    sheet(sheet) {
      set({ sheet: sheet === state().panels.sheet ? null : sheet, sure: "" });
    },
    openPanel,
    togglePanel(name) {
      const { left, right } = shownPanels(state().panels);
      if (state().panels.allAlarms) openPanel(name); // they may lie over it
      else if (left === name) set({ left: null });
      else if (right === name) set({ right: null });
      else openPanel(name);
    },
    edit,
    refuse,
    acknowledge: (alarm) => void service.acknowledge(alarm),
    acknowledgeAll: () => void service.acknowledge(null),
    sound: (on) => dispatch({ kind: "sound", on }),

    show: (command) => void service.show(command),
    async start() {
      const command = startOrder(state());
      if (typeof command === "string") return refuse(texts.start.title, command);
      const begins = beginOrder(state());
      if (typeof begins === "string") return refuse(texts.begin.title, begins);
      if (begins !== null && !(await service.begin(begins))) return; // it would begin at once
      if (await service.start(command.vehicles, command.at_unix_time_s)) {
        set({ sheet: null, startAt: false, startNamed: false, beginAt: false });
        undo("start-");
        undo("begin-");
      }
    },
    async begin() {
      const { panels, frame } = state();
      const at_s = beginTime(panels.drafts["begin-time"] ?? "", frame?.unix_time_s ?? NaN);
      if (typeof at_s === "string") return refuse(texts.begin.title, at_s);
      if (await service.begin(at_s)) {
        set({ sheet: null });
        undo("begin-");
      }
    },
    cancelBegin: () => void service.cancelBegin(),
    vehicle: (id, command) => void service.vehicle(id, command),
    fleet: (command) => void service.fleet(command, state().view.selection),
    exclude: (id) => void excluded(id),
    mend: (action) => void mend(action),
    follow: (alarm) => void follow(alarm),
    async include(id) {
      if (await service.vehicle(id, "include")) await service.loadPreflight();
    },
    apply: (group) => void apply(group),
    changeOrbit: service.changeOrbit,
    changeYaw: service.changeYaw,
    saveObstacle: () => void saveObstacle(),
    async removeObstacle(id) {
      set({ sure: "" });
      return service.removeObstacle(id);
    },
    confirmPreview() {
      const { preview } = state();
      if (preview === null) return void saveObstacle();
      dispatch({ kind: "preview", preview: null });
      void service.sendPreview(preview);
    },
    cancelPreview: () => (state().preview === null ? edit(null) : dispatch({ kind: "preview", preview: null })),
    shapeObstacle(id, change) {
      if (state().panels.editing !== id) edit(id);
      for (const [name, value] of Object.entries(change)) dispatch({ kind: "draft", field: fieldOf(name as keyof Box), text: String(value) });
    },
    armKill: (vehicles) => void service.armKill(vehicles),
    confirmTyped: () => void confirmKill(state().panels.drafts["kill-typed"] ?? ""),
    holdKill() {
      const { kill, page_ms } = state();
      if (kill === null || state().panels.holding_ms !== null) return;
      set({ holding_ms: page_ms });
      clearTimeout(holding);
      holding = window.setTimeout(() => {
        const now = state();
        if (now.panels.holding_ms !== null && now.kill !== null) void confirmKill(now.kill.armed.code);
        releaseKill();
      }, HOLD_MS);
    },
    releaseKill,
    disarmKill() {
      releaseKill();
      dispatch({ kind: "kill-over" });
    },
    readPreflight: () => void service.loadPreflight(),
    takeLead() {
      set({ sure: "" });
      void service.takeLead();
    },
    ask: service.ask,
    checkShow: service.checkShow,
    selectShow: service.selectShow,
    deselectShow: service.deselectShow,
    async removeShow(name) {
      set({ sure: "" });
      return (await service.removeShow(name)) && service.loadShows();
    },
    seek: service.seek,
    upload: (file) => void upload(file),
    previewShow: (name) => void previewShow(name),
    placeShow: (name) => void placeShow(name),
    placeAt: (place) => dispatch({ kind: "placed-at", place }),
    fitPlacement() {
      const { placing } = state();
      if (placing !== null) void service.loadPlacement(placing.found.show, placing.place, true);
    },
    applyPlacement: () => void applyPlacement(),
    closePlacing: () => dispatch({ kind: "placing", found: null, asked: null }),
    saveSite() {
      const { site: { edit }, status } = state();
      if (edit !== null && status !== null) void service.changeSite(geojson(edit, status.origin), edit.version);
    },
    enter() {
      const token = (state().panels.drafts["token"] ?? "").trim();
      undo("token");
      if (token !== "") login(token);
    },
    replay: (change) => void service.replay(change).finally(() => undo("scrubber")),
    readReport: () => void readReport(),
  };
}
