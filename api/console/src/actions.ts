// Calls of the service. Each reports its result; the page shows no success before the service answers.

import type { Features, Preview, Command, DrawnSamples, ImportedShow, PlacedShow, Placement, ShowCheck, Site, State, Station, StoredShow } from "./state";
import { decoded } from "./drawn/model";
import type { Box } from "./obstacle";
import { t as siteTexts } from "./site/texts";
import { clockTime } from "./panels/format";
import { texts } from "./texts";
import type { Message } from "./messages";
import { outcome, type Api, type Outcome } from "./connection/rest";
import type { components } from "./schemas/schema";

type Schemas = components["schemas"];
type Call<T> = Promise<{ data?: T; error?: unknown; response: Response }>;
export type ShowCommand = "pause" | "resume" | "stop" | "abort" | "take-over" | "bring-home";
export type VehicleCommand = "hold" | "join" | "return" | "land" | "take-control" | "confirm-down" | "find" | "include";
export type FleetCommand = "hold" | "join" | "return" | "land" | "take-control";
export type ReplayChange = { paused?: boolean; speed?: number; position_s?: number; skips_idle?: boolean };
export type DrawingFormat = "skyc" | "zip" | "csv";

/** Each resolves to whether the service accepted it; a refusal is shown before that. */
export interface Actions {
  /** Start the selected show, or the formation under manual control; null: all that are not left out, at once. */
  start(vehicles: readonly string[] | null, at_unix_time_s: number | null): Promise<boolean>;
  /** When the selected show begins to move. */
  begin(at_unix_time_s: number): Promise<boolean>;
  cancelBegin(): Promise<boolean>;
  show(command: ShowCommand): Promise<boolean>;
  /** A call of a feature's own; `text` is shown once it is accepted. */
  ask<T>(name: string, call: (api: Api) => Call<T>, text: string): Promise<boolean>;
  vehicle(id: string, command: VehicleCommand): Promise<boolean>;
  /** One command for all of these. */
  fleet(command: FleetCommand, vehicles: readonly string[]): Promise<boolean>;
  exclude(id: string, reason: string): Promise<boolean>;
  changeFormation(change: { radius_m?: number; height_m?: number }): Promise<boolean>;
  changeOrbit(change: { radius_m?: number; speed_m_s?: number; direction?: Schemas["Direction"] }): Promise<boolean>;
  changeYaw(change: { policy?: Schemas["YawPolicy"]; heading_deg?: number }): Promise<boolean>;
  setTarget(target: { x_m: number; y_m: number; velocity_x_m_s?: number; velocity_y_m_s?: number }): Promise<boolean>;
  /** Without an id the service makes one. */
  addObstacle(id: string | null, box: Box): Promise<boolean>;
  /** What is not named stays as it is. */
  changeObstacle(id: string, change: Partial<Box>): Promise<boolean>;
  removeObstacle(id: string): Promise<boolean>;
  /** The values that were dragged. */
  sendPreview(preview: Preview): Promise<boolean>;
  /** First step; without names for all vehicles that are not offline. */
  armKill(vehicles: readonly string[] | null): Promise<boolean>;
  /** Second step. */
  confirmKill(code: string): Promise<boolean>;
  /** For a start of these vehicles; null: of all that are not left out. */
  loadPreflight(vehicles?: readonly string[] | null): Promise<boolean>;
  loadOrders(): Promise<boolean>;
  loadStations(): Promise<boolean>;
  loadFeatures(): Promise<boolean>;
  /** Have the station that answers this page lead. */
  takeLead(): Promise<boolean>;
  loadShows(): Promise<boolean>;
  /** `again`: once an earlier check of it has ended. */
  checkShow(name: string, again?: boolean): Promise<boolean>;
  selectShow(name: string, hash: string): Promise<boolean>;
  deselectShow(): Promise<boolean>;
  uploadShow(name: string, yaml: string): Promise<boolean>;
  /** Make a show of a drawing; the format is its file's suffix. */
  importDrawing(name: string, format: DrawingFormat, file: Blob): Promise<boolean>;
  /** Open the preview of a drawn show. */
  loadDrawing(name: string): Promise<boolean>;
  /** Where a drawn show lies, or would lie; `fit`: from there on, where its pads are best for the vehicles. */
  loadPlacement(name: string, place: Placement | null, fit: boolean): Promise<boolean>;
  /** Store a placement: a new version of the show. */
  place(name: string, place: Placement): Promise<boolean>;
  removeShow(name: string): Promise<boolean>;
  loadSite(): Promise<boolean>;
  /** Store the whole site, made of that version of its file. */
  changeSite(geojson: string, version: string): Promise<boolean>;
  seek(cue: string): Promise<boolean>;
  /** One alarm; null: all of them. */
  acknowledge(alarm: string | null): Promise<boolean>;
  replay(change: ReplayChange): Promise<boolean>;
  loadMarks(): Promise<boolean>;
  loadReport(): Promise<boolean>;
}

const POLL_MS = 500;
const later = (ms: number): Promise<void> => new Promise((resolve) => setTimeout(resolve, ms));

export function createActions(api: Api, dispatch: (message: Message) => void, state: () => State): Actions {
  /** The data, or null after a refusal, which is shown. */
  async function asked<T>(name: string, call: Call<T>, done: string | null): Promise<{ data: T } | null> {
    const result: Outcome<T> = await outcome(call);
    if (!result.ok) {
      dispatch({ kind: "refused", text: texts.refused(name, result.reason) });
      return null;
    }
    if (done !== null) dispatch({ kind: "done", text: done });
    return { data: result.data };
  }

  async function done<T>(name: string, call: Call<T>, text: string): Promise<boolean> {
    return (await asked(name, call, text)) !== null;
  }

  /** Without a message: data that cannot be read are reported where they would be shown. */
  async function read<T>(call: Call<T>, found: (data: T) => Message, problem: (reason: string) => Message): Promise<boolean> {
    const result: Outcome<T> = await outcome(call);
    dispatch(result.ok ? found(result.data) : problem(result.reason));
    return result.ok;
  }

  /** Poll the outcome of a command until it is known. */
  async function follow(name: string, first: Command): Promise<void> {
    let command = first;
    dispatch({ kind: "command", command });
    while (command.outcome === "pending") {
      await later(POLL_MS);
      const next: Outcome<Command> = await outcome(api.GET("/api/v1/commands/{command_id}", { params: { path: { command_id: command.id } } }));
      if (next.ok) command = next.data;
      else if (next.status !== 0) return; // the service was restarted: it no longer knows this command
      dispatch({ kind: "command", command });
    }
    if (command.outcome !== "failed") return;
    const why = Object.entries(command.outcomes).filter(([, part]) => part.outcome === "failed");
    dispatch({ kind: "refused", text: texts.failed(name, why.map(([id, part]) => `${id}: ${part.reason}`).join("; ")) });
  }

  async function commanded(name: string, call: Call<Command>): Promise<boolean> {
    const accepted = await asked(name, call, texts.commanded(name));
    if (accepted !== null) void follow(name, accepted.data);
    return accepted !== null;
  }

  const isChecking = (check: ShowCheck | undefined): boolean => check?.state === "waiting" || check?.state === "running";

  /** `again`: the show is another one since an earlier check began, which has to end first. */
  async function followCheck(name: string, again = false): Promise<boolean> {
    const path = { params: { path: { name } } };
    for (let earlier = again ? state().panels.checks[name] : undefined; isChecking(earlier); ) {
      await later(POLL_MS);
      const now: Outcome<ShowCheck> = await outcome(api.GET("/api/v1/shows/{name}/check", path));
      earlier = now.ok ? now.data : undefined;
    }
    let check = await asked(texts.commands.check(name), api.POST("/api/v1/shows/{name}/check", path), null);
    const accepted = check !== null;
    while (check !== null) {
      dispatch({ kind: "check", check: check.data });
      if (!isChecking(check.data)) break;
      await later(POLL_MS);
      check = await asked(texts.commands.check(name), api.GET("/api/v1/shows/{name}/check", path), null);
    }
    return accepted;
  }

  const ofVehicle = (id: string) => ({ params: { path: { vehicle_id: id } } });
  const ofShow = (name: string) => ({ params: { path: { name } } });
  const ofObstacle = (id: string) => ({ params: { path: { obstacle_id: id } } });

  const actions: Actions = {
    start(vehicles, at_unix_time_s) {
      const selected = state().status?.show.selected;
      const body: Schemas["StartBody"] = {
        ...(vehicles === null ? {} : { vehicles: [...vehicles] }),
        ...(selected ? { show_hash: selected.hash } : {}),
        ...(at_unix_time_s === null ? {} : { at_unix_time_s }),
      };
      return commanded(texts.flight.start, api.POST("/api/v1/show/start", { body }));
    },
    begin: (at_unix_time_s) =>
      done(texts.begin.title, api.POST("/api/v1/show/begin", { body: { at_unix_time_s } }), texts.begin.given(clockTime(at_unix_time_s))),
    cancelBegin: () => done(texts.begin.cancel, api.DELETE("/api/v1/show/begin"), texts.begin.cancelled),
    ask: (name, call, text) => done(name, call(api), text),
    show: (command) => commanded(texts.commands.show[command], api.POST(`/api/v1/show/${command}`)),
    vehicle: (id, command) =>
      commanded(texts.commands.vehicle(texts.vehicle.actions[command], id), api.POST(`/api/v1/vehicles/{vehicle_id}/${command}`, ofVehicle(id))),
    async fleet(command, vehicles) {
      const name = texts.commands.fleet(texts.vehicle.actions[command], vehicles);
      const accepted = await asked(name, api.POST(`/api/v1/fleet/${command}`, { body: { vehicles: [...vehicles] } }), null);
      if (accepted === null) return false;
      const parts = Object.entries(accepted.data.outcomes);
      const reached = parts.filter(([, part]) => part.outcome !== "not-included").map(([id]) => id);
      const missed = parts.filter(([id, part]) => part.outcome === "not-included" && vehicles.includes(id));
      dispatch({ kind: "done", text: texts.commanded(texts.commands.fleet(texts.vehicle.actions[command], reached)) });
      if (missed.length > 0) dispatch({ kind: "refused", text: texts.refused(name, missed.map(([id, part]) => `${id}: ${part.reason}`).join("; ")) });
      void follow(name, accepted.data);
      return true;
    },
    exclude: (id, reason) =>
      commanded(texts.preflight.excludeOne(id), api.POST("/api/v1/vehicles/{vehicle_id}/exclude", { ...ofVehicle(id), body: { reason } })),
    changeFormation: (body) => done(texts.shape.sphere, api.PATCH("/api/v1/formation", { body }), texts.formationChanged),
    changeOrbit: (body) => done(texts.shape.orbit, api.PATCH("/api/v1/orbit", { body }), texts.orbitChanged),
    changeYaw: (body) => done(texts.shape.yaw, api.PATCH("/api/v1/yaw", { body }), texts.yawChanged),
    setTarget: (target) => done(texts.shape.target, api.PUT("/api/v1/target", { body: target as Schemas["ShowTarget"] }), texts.targetMoved),
    addObstacle(id, box) {
      const body = { ...box, ...(id === null ? {} : { id }) } as Schemas["ObstaclePost"];
      return done(texts.obstacles.add, api.POST("/api/v1/obstacles", { body }), texts.obstacleAdded(id));
    },
    async changeObstacle(id, change) {
      const known = state().status?.obstacles.find((each) => each.id === id);
      const name = texts.obstacles.of(id);
      if (known === undefined) {
        dispatch({ kind: "refused", text: texts.refused(name, texts.obstacleRemoved(id)) });
        return false;
      }
      return done(name, api.PUT("/api/v1/obstacles/{obstacle_id}", { ...ofObstacle(id), body: { ...known, ...change } }), texts.obstacleMoved(id));
    },
    removeObstacle: (id) =>
      done(texts.obstacles.of(id), api.DELETE("/api/v1/obstacles/{obstacle_id}", ofObstacle(id)), texts.obstacleRemoved(id)),
    sendPreview(preview) {
      switch (preview.kind) {
        case "target":
          return actions.setTarget({ x_m: preview.x_m, y_m: preview.y_m });
        case "radius":
          return actions.changeFormation({ radius_m: preview.radius_m });
      }
    },
    async armKill(vehicles) {
      const body = vehicles === null ? {} : { vehicles: [...vehicles] };
      const armed = await asked(texts.commands.arm, api.POST("/api/v1/kill", { body }), null);
      if (armed !== null) dispatch({ kind: "kill-armed", armed: armed.data });
      return armed !== null;
    },
    async confirmKill(code) {
      const sent = await asked(texts.flight.kill, api.POST("/api/v1/kill/confirm", { body: { code } }), null);
      if (sent === null) return false;
      dispatch({ kind: "grave", text: texts.kill.sent(Object.keys(sent.data.outcomes)) });
      void follow(texts.flight.kill, sent.data);
      return true;
    },
    loadPreflight: (vehicles = null) =>
      read(
        api.GET("/api/v1/preflight", { params: { query: vehicles === null ? {} : { vehicles: [...vehicles] } } }),
        (report) => ({ kind: "preflight", report, vehicles }),
        (preflightProblem) => ({ kind: "panels", change: { preflightProblem } }),
      ),
    async loadOrders() {
      const result: Outcome<Command[]> = await outcome(api.GET("/api/v1/commands"));
      if (result.ok) dispatch({ kind: "commands", commands: result.data });
      return result.ok;
    },
    async loadStations() {
      const result: Outcome<Station[]> = await outcome(api.GET("/api/v1/stations"));
      if (result.ok) dispatch({ kind: "stations", stations: result.data });
      return result.ok;
    },
    async loadFeatures() {
      const result: Outcome<Features> = await outcome(api.GET("/api/v1/features"));
      if (result.ok) dispatch({ kind: "features", features: result.data });
      return result.ok;
    },
    async takeLead() {
      const taken = await asked(texts.stations.take, api.POST("/api/v1/stations/lead"), texts.stations.taken);
      if (taken !== null) dispatch({ kind: "stations", stations: taken.data });
      return taken !== null;
    },
    async loadShows() {
      const result: Outcome<StoredShow[]> = await outcome(api.GET("/api/v1/shows"));
      dispatch(result.ok ? { kind: "shows", shows: result.data } : { kind: "panels", change: { showsProblem: result.reason } });
      for (const { name } of result.ok ? result.data : []) {
        const known: Outcome<ShowCheck> = await outcome(api.GET("/api/v1/shows/{name}/check", ofShow(name)));
        if (known.ok) dispatch({ kind: "check", check: known.data }); // else it was never checked
      }
      return result.ok;
    },
    checkShow: followCheck,
    async selectShow(name, hash) {
      const result = await outcome(api.POST("/api/v1/shows/{name}/select", { ...ofShow(name), body: { hash } }));
      dispatch({ kind: "show-selected", name, hash, problem: result.ok ? "" : result.reason });
      if (result.ok) dispatch({ kind: "done", text: texts.showSelected(name) });
      else dispatch({ kind: "refused", text: texts.refused(texts.commands.select(name), result.reason) });
      return result.ok;
    },
    deselectShow: () => done(texts.shows.deselect, api.POST("/api/v1/show/deselect"), texts.showDeselected),
    uploadShow(name, yaml) {
      const headers = { "Content-Type": "application/yaml" };
      const call = api.PUT("/api/v1/shows/{name}", { ...ofShow(name), body: yaml as never, bodySerializer: () => yaml, headers });
      return done(texts.commands.upload(name), call, texts.showUploaded(name));
    },
    async importDrawing(name, format, file) {
      const call = api.POST("/api/v1/shows", {
        params: { query: { name, format } }, body: file as never, bodySerializer: () => file, headers: { "Content-Type": "application/octet-stream" },
      });
      const found: { data: ImportedShow } | null = await asked(texts.commands.upload(name), call, null);
      if (found !== null) dispatch({ kind: "done", text: texts.drawn.imported(name, found.data.vehicles, found.data.duration_s, found.data.notes) });
      return found !== null;
    },
    async loadDrawing(name) {
      const call: Call<DrawnSamples> = api.GET("/api/v1/shows/{name}/drawing", ofShow(name));
      const found = await asked(texts.commands.preview(name), call, null);
      if (found !== null) dispatch({ kind: "drawn", drawing: decoded(found.data) });
      return found !== null;
    },
    async loadPlacement(name, place, fit) {
      const query = { ...(place ?? {}), ...(fit ? { fit } : {}) };
      const call: Call<PlacedShow> = api.GET("/api/v1/shows/{name}/placement", { params: { path: { name }, query } });
      if (fit) dispatch({ kind: "placing-busy", busy: "fit" });
      const found = await asked(texts.commands.place(name), call, null);
      if (found !== null) dispatch({ kind: "placing", found: found.data, asked: fit ? null : place });
      else if (fit) dispatch({ kind: "placing-busy", busy: "" });
      return found !== null;
    },
    async place(name, place) {
      dispatch({ kind: "placing-busy", busy: "apply" });
      const call: Call<PlacedShow> = api.PUT("/api/v1/shows/{name}/placement", { ...ofShow(name), body: place });
      const found = await asked(texts.commands.place(name), call, texts.placing.applied(name));
      if (found !== null) dispatch({ kind: "placing", found: found.data, asked: null });
      else dispatch({ kind: "placing-busy", busy: "" });
      return found !== null;
    },
    async loadSite() {
      const result: Outcome<Site> = await outcome(api.GET("/api/v1/site"));
      if (result.ok) dispatch({ kind: "site", site: result.data, isSaved: false });
      return result.ok;
    },
    async changeSite(geojson, version) {
      dispatch({ kind: "site-saving" });
      const call: Call<Site> = api.PUT("/api/v1/site", {
        params: { query: { version } }, body: geojson as never, bodySerializer: () => geojson, headers: { "Content-Type": "application/geo+json" },
      });
      const result = await outcome(call);
      if (result.ok) {
        dispatch({ kind: "site", site: result.data, isSaved: true });
        dispatch({ kind: "done", text: result.data.pending === "" ? siteTexts.storedAgain : siteTexts.stored });
      } else {
        dispatch({ kind: "site-refused", reason: result.reason });
        if (result.status !== 422) dispatch({ kind: "refused", text: texts.refused(siteTexts.save, result.reason) }); // else it is at its corner
      }
      return result.ok;
    },
    removeShow: (name) => done(texts.commands.remove(name), api.DELETE("/api/v1/shows/{name}", ofShow(name)), texts.showRemoved(name)),
    seek: (cue) => done(texts.commands.seek(cue), api.POST("/api/v1/show/seek", { body: { cue } }), texts.showSought(cue)),
    acknowledge: async (alarm) => {
      const call: Call<unknown> =
        alarm === null
          ? api.POST("/api/v1/alarms/acknowledge")
          : api.POST("/api/v1/alarms/{alarm_id}/acknowledge", { params: { path: { alarm_id: alarm } } });
      return (await asked(texts.alarms.acknowledge, call, null)) !== null;
    },
    /** The effect is visible: no message is needed. */
    loadMarks: () =>
      read(
        api.GET("/api/v1/show/marks"),
        (marks) => ({ kind: "marks", marks }),
        (reason) => ({ kind: "refused", text: texts.refused(texts.timeline.title, reason) }),
      ),
    replay: async (change) => (await asked(texts.replay.title, api.POST("/api/v1/replay", { body: change }), null)) !== null,
    async loadReport() {
      for (;;) {
        const result: Outcome<Schemas["ReportState"]> = await outcome(api.GET("/api/v1/replay/report"));
        const found = result.ok ? result.data : null;
        if (found !== null && (found.state === "waiting" || found.state === "running")) {
          await later(POLL_MS);
          continue;
        }
        if (found?.report) dispatch({ kind: "flightReport", flightReport: found.report });
        const reportProblem = result.ok ? result.data.reason : result.reason;
        dispatch({ kind: "panels", change: { reportProblem } });
        return reportProblem === "";
      }
    },
  };
  return actions;
}
