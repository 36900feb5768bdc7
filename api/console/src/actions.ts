// What a person can do here. Each asks the service and tells what came of it; nothing is believed before it answers.

import type { Ghost, Order, State } from "./state";
import { texts } from "./texts";
import type { Message } from "./update";
import { outcome, type Api, type Outcome } from "./wire/rest";
import type { components } from "./wire/schema";

type Schemas = components["schemas"];
export type ShowCommand = "pause" | "resume" | "stop" | "abort" | "take-over" | "bring-home";
export type VehicleCommand = "hold" | "join" | "return" | "land" | "hand-back" | "confirm-down" | "include";
export type ReplayChange = { paused?: boolean; speed?: number; position_s?: number };

export interface Actions {
  /** Of the page alone: camera, sorting, dialogs, ghosts. */
  dispatch(message: Message): void;
  /** The selected show, or as the formation is told; at a clock time, or now. */
  start(at_unix_time_s?: number): Promise<void>;
  show(command: ShowCommand): Promise<void>;
  vehicle(id: string, command: VehicleCommand): Promise<void>;
  exclude(id: string, reason: string): Promise<void>;
  changeFormation(change: { radius_m?: number; height_m?: number }): Promise<void>;
  changeOrbit(change: { radius_m?: number; speed_m_s?: number; direction?: Schemas["Direction"] }): Promise<void>;
  changeYaw(change: { policy?: Schemas["YawPolicy"]; heading_deg?: number }): Promise<void>;
  removeObstacle(id: string): Promise<void>;
  /** Send what was dragged or typed. */
  confirmGhost(): Promise<void>;
  cancelGhost(): void;
  /** First step; of all that are not offline when nobody is named. */
  armKill(vehicles?: readonly string[]): Promise<void>;
  /** Second step. */
  confirmKill(): Promise<void>;
  loadPreflight(): Promise<void>;
  loadOrders(): Promise<void>;
  loadShows(): Promise<void>;
  checkShow(name: string): Promise<void>;
  selectShow(name: string, hash: string): Promise<void>;
  deselectShow(): Promise<void>;
  seek(cue: string): Promise<void>;
  login(token: string): void;
  logout(): void;
  replay(change: ReplayChange): Promise<void>;
  loadCertificate(): Promise<void>;
}

const ORDER_POLL_MS = 500;
const later = (ms: number): Promise<void> => new Promise((resolve) => setTimeout(resolve, ms));

export interface Session {
  token(): string;
  login(token: string): void;
  logout(): void;
}

export function createActions(api: Api, session: Session, dispatch: (message: Message) => void, state: () => State): Actions {
  const refused = (reason: string): void => dispatch({ kind: "refused", text: reason });

  /** Tell what came of it; the data, or null when it was refused. */
  async function told<T>(call: Promise<{ data?: T; error?: unknown; response: Response }>, done: string | null): Promise<T | null> {
    const result: Outcome<T> = await outcome(call);
    if (!result.ok) {
      refused(result.reason);
      return null;
    }
    if (done !== null) dispatch({ kind: "done", text: done });
    return result.data;
  }

  /** An order is accepted at once; what becomes of it is asked until it is known. */
  async function ordered(name: string, call: Promise<{ data?: Order; error?: unknown; response: Response }>): Promise<void> {
    let order = await told(call, texts.ordered(name));
    while (order !== null) {
      dispatch({ kind: "order", order });
      if (order.outcome !== "pending") break;
      await later(ORDER_POLL_MS);
      const next: Outcome<Order> = await outcome(
        api.GET("/api/v1/orders/{order_id}", { params: { path: { order_id: order.id } } }),
      );
      if (next.ok) order = next.data;
      else if (next.status !== 0) return; // the service was started again: it knows this order no more
    }
    if (order?.outcome === "failed") {
      const why = Object.entries(order.vehicles).filter(([, part]) => part.outcome === "failed");
      refused(texts.failed(name, why.map(([id, part]) => `${id}: ${part.reason}`).join("; ")));
    }
  }

  const vehiclePath = (id: string) => ({ params: { path: { vehicle_id: id } } });
  const showPath = (name: string) => ({ params: { path: { name } } });

  async function sendGhost(ghost: Ghost): Promise<unknown> {
    switch (ghost.kind) {
      case "target":
        return told(api.PUT("/api/v1/target", { body: { x_m: ghost.x_m, y_m: ghost.y_m } as Schemas["ShowTarget"] }), texts.targetMoved);
      case "radius":
        return told(api.PATCH("/api/v1/formation", { body: { radius_m: ghost.radius_m } }), texts.formationChanged);
      case "new-obstacle": {
        const { kind: _kind, ...box } = ghost;
        const made = await told(api.POST("/api/v1/obstacles", { body: box as Schemas["ObstaclePost"] }), null);
        if (made !== null) dispatch({ kind: "done", text: texts.obstacleAdded(made.id) });
        return made;
      }
      case "obstacle": {
        const known = state().status?.obstacles.find((each) => each.id === ghost.id);
        if (known === undefined) {
          refused(texts.obstacleRemoved(ghost.id));
          return null;
        }
        const body = { ...known, x_m: ghost.x_m, y_m: ghost.y_m };
        const path = { obstacle_id: ghost.id };
        return told(api.PUT("/api/v1/obstacles/{obstacle_id}", { params: { path }, body }), texts.obstacleMoved(ghost.id));
      }
    }
  }

  return {
    dispatch,
    async start(at_unix_time_s) {
      const selected = state().status?.show.selected;
      const body: Schemas["StartBody"] = {
        ...(selected ? { show_hash: selected.hash } : {}),
        ...(at_unix_time_s === undefined ? {} : { at_unix_time_s }),
      };
      await ordered("start", api.POST("/api/v1/show/start", { body }));
    },
    show: (command) => ordered(command, api.POST(`/api/v1/show/${command}`)),
    vehicle: (id, command) =>
      ordered(`${id} ${command}`, api.POST(`/api/v1/vehicles/{vehicle_id}/${command}`, vehiclePath(id))),
    exclude: (id, reason) =>
      ordered(`${id} exclude`, api.POST("/api/v1/vehicles/{vehicle_id}/exclude", { ...vehiclePath(id), body: { reason } })),
    async changeFormation(change) {
      await told(api.PATCH("/api/v1/formation", { body: change }), texts.formationChanged);
    },
    async changeOrbit(change) {
      await told(api.PATCH("/api/v1/orbit", { body: change }), texts.orbitChanged);
    },
    async changeYaw(change) {
      await told(api.PATCH("/api/v1/yaw", { body: change }), texts.yawChanged);
    },
    async removeObstacle(id) {
      const path = { obstacle_id: id };
      await told(api.DELETE("/api/v1/obstacles/{obstacle_id}", { params: { path } }), texts.obstacleRemoved(id));
    },
    async confirmGhost() {
      const ghost = state().ghost;
      if (ghost === null) return;
      dispatch({ kind: "ghost", ghost: null });
      await sendGhost(ghost);
    },
    cancelGhost: () => dispatch({ kind: "ghost", ghost: null }),
    async armKill(vehicles) {
      const body = vehicles === undefined ? {} : { vehicles: [...vehicles] };
      const armed = await told(api.POST("/api/v1/kill", { body }), null);
      if (armed !== null) dispatch({ kind: "kill-armed", armed });
    },
    async confirmKill() {
      const kill = state().kill;
      if (kill === null) return refused(texts.noKill);
      dispatch({ kind: "kill-over" });
      await ordered("kill", api.POST("/api/v1/kill/confirm", { body: { code: kill.armed.code } }));
    },
    async loadPreflight() {
      const report = await told(api.GET("/api/v1/preflight"), null);
      if (report !== null) dispatch({ kind: "preflight", report });
    },
    async loadOrders() {
      const orders = await told(api.GET("/api/v1/orders"), null);
      if (orders !== null) dispatch({ kind: "orders", orders: [...orders].reverse() });
    },
    async loadShows() {
      const shows = await told(api.GET("/api/v1/shows"), null);
      if (shows !== null) dispatch({ kind: "shows", shows });
    },
    async checkShow(name) {
      let check = await told(api.POST("/api/v1/shows/{name}/check", showPath(name)), null);
      while (check !== null) {
        dispatch({ kind: "check", check });
        if (check.state !== "running") return;
        await later(ORDER_POLL_MS);
        check = await told(api.GET("/api/v1/shows/{name}/check", showPath(name)), null);
      }
    },
    async selectShow(name, hash) {
      const body = { ...showPath(name), body: { hash } };
      if (await told(api.POST("/api/v1/shows/{name}/select", body), texts.showSelected(name))) return;
    },
    async deselectShow() {
      await told(api.POST("/api/v1/show/deselect"), texts.showDeselected);
    },
    async seek(cue) {
      await told(api.POST("/api/v1/show/seek", { body: { cue } }), texts.showSought(cue));
    },
    login: session.login,
    logout: session.logout,
    async replay(_change) {
      refused(texts.noReplay);
    },
    async loadCertificate() {
      refused(texts.noReplay);
    },
  };
}
