// The scene: one call per animation frame. It reads the state, and keeps what is on the graphics card and the camera.

import "../styles/scene.css";

import { Color, Group, Scene as Root, SRGBColorSpace } from "three";

import { features } from "../features";
import type { Question } from "../features/feature";
import { isUnplaced, type Box } from "../obstacle";
import { cornerGripAt, cornerMoved, type CornerGrip } from "../site/layer";
import type { SiteMessage } from "../site/model";
import { tail } from "../panels/format";
import { isGridSeen } from "../panels/layout";
import type { Choice } from "../selection";
import { fresh, indexOf, may, type Frame, type Placement, type Preview, type State, type Status } from "../state";
import { texts } from "../texts";
import type { LoadTile } from "../connection/tiles";
import { north_rad } from "./axes";
import { Backdrop } from "./backdrop";
import { Billboards } from "./billboards";
import { CameraController } from "./cameraController";
import { closePairs, type Floor, type Pair } from "./proximity";
import { Controls, type Keys } from "./controls";
import { Eye } from "./camera";
import { gripAt, handleOf, moved, placedAt, type Dragged, type Grip } from "./dragPreviews";
import { Grid } from "./grid";
import { Ground } from "./ground";
import { Table } from "./instances";
import { DrawnLayer } from "./drawing";
import { DynamicLayer, type Picture } from "./dynamicLayer";
import { Appearance } from "./appearance";
import { Overlay } from "./overlay";
import { padGripAt, PadsLayer, padsMoved, type PadGrip } from "./padsLayer";
import { DAY, NIGHT, type Palette } from "./palette";
import { nearestPlace, placesWithin, rayThrough, type Ray, type Screen } from "./picking";
import { placeOf, Playback, Poses, type Moment } from "./playback";
import { createRenderer, isDue, screenOf } from "./renderer";
import { Scenery } from "./scenery";
import { SelectionBox, type Rect } from "./selectionBox";
import { Shell } from "./shell";
import { Trails } from "./trails";
import { REPORTED, Vehicles } from "./vehicles";

export interface Scene {
  /** Reads the state; keeps GPU objects, trails and the camera alone. */
  draw(state: State, now_ms: number): void;
  resize(width: number, height: number, pixelRatio: number): void;
  /** A button or a finger is down on it: until it is let go, the scene stays where it is. */
  readonly isHeld: boolean;
  dispose(): void;
}

export interface SceneEvents {
  /** During a drag: the values it would set. It sends no command. */
  preview(preview: Preview | null): void;
  /** Likewise, of an obstacle. */
  shape(id: string, change: Partial<Box>): void;
  /** Likewise, of a drawn show that is being placed. */
  place(place: Placement): void;
  /** Likewise, of the site that is edited. */
  site(message: SiteMessage): void;
  choose(choice: Choice): void;
  /** A click on what a feature has drawn. */
  ask(question: Question): void;
}

const HELD_MOST_MS = 250;
const PICK_PX = 18;
const NAMED_UP_TO = 16; // vehicles
const NAME_LETTERS = 16;
const PAD_HEIGHT_M = 2; // as the safety filter's: lower pairs do not count

/** Throws: Error where the browser has no WebGL 2. */
export function createScene(canvas: HTMLCanvasElement, on: SceneEvents, tile: LoadTile): Scene {
  return new LiveScene(canvas, on, tile);
}

class LiveScene implements Scene {
  readonly #canvas: HTMLCanvasElement;
  readonly #on: SceneEvents;
  readonly #fitted;
  readonly #eye;
  readonly #root = new Root();
  readonly #backdrop = new Backdrop();
  readonly #grid;
  readonly #ground;
  readonly #reported = new Table(REPORTED);
  readonly #vehicles;
  readonly #billboards;
  readonly #trails;
  readonly #shell;
  readonly #scenery;
  readonly #dynamicLayer;
  readonly #drawn;
  readonly #pads;
  readonly #layers;
  readonly #overlay;
  readonly #box;
  readonly #controls;
  readonly #observer;
  readonly #camera_controller = new CameraController();
  readonly #playback = new Playback();
  readonly #poses = new Poses();
  readonly #appearance = new Appearance();
  #size = { width: 1, height: 1, ratio: 1 };
  #measured: Screen | null = null; // until something changes: to measure costs the page a layout
  #state: State | null = null;
  #pairs: { of: Frame | null; list: readonly Pair[] } = { of: null, list: [] };
  #selection: { of: readonly string[]; status: Status | null; indices: ReadonlySet<number> } = { of: [], status: null, indices: new Set() };
  #grip: Grip | null = null;
  #padGrip: PadGrip | null = null;
  #cornerGrip: CornerGrip | null = null;
  #drags = 0;
  #hovered = -1;
  #isDue = true;
  #wasFresh = false;
  #drawn_ms = -Infinity;
  #held_ms: number | null = 0; // how long the last picture held the page up
  #palette: Palette | null = null;

  constructor(canvas: HTMLCanvasElement, on: SceneEvents, tile: LoadTile) {
    this.#canvas = canvas;
    this.#on = on;
    this.#fitted = createRenderer(canvas);
    this.#eye = new Eye(this.#camera_controller.pose, this.#screen());
    const { shared } = this.#eye;
    const all = new Group();
    this.#grid = new Grid(shared);
    this.#ground = new Ground(shared, tile, () => (this.#isDue = true));
    this.#vehicles = new Vehicles(shared);
    this.#billboards = new Billboards(shared);
    this.#trails = new Trails(shared);
    this.#shell = new Shell(shared);
    this.#scenery = new Scenery(shared, all);
    this.#dynamicLayer = new DynamicLayer(shared, all);
    this.#drawn = new DrawnLayer(shared, all);
    this.#pads = new PadsLayer(shared, all);
    this.#layers = features.flatMap((each) => each.layer?.(shared, all) ?? []);
    all.add(
      this.#backdrop.mesh, this.#ground.group, this.#grid.mesh, this.#vehicles.mesh, this.#billboards.mesh, this.#trails.mesh, this.#shell.group,
    );
    this.#root.add(all);
    const parent = canvas.parentElement ?? document.body;
    this.#overlay = new Overlay(parent);
    this.#box = new SelectionBox(parent);
    this.#controls = new Controls(canvas, this.#hands());
    this.#observer = new ResizeObserver(() => this.#remeasure()); // also when what is left free changes
    this.#observer.observe(parent);
  }

  draw(state: State, now_ms: number): void {
    const isFresh = fresh(state);
    this.#held_ms ??= Math.min(HELD_MOST_MS, now_ms - this.#drawn_ms); // the first beat after a picture
    if (state.frame !== null) {
      this.#playback.push(state.frame);
    }
    const moment = this.#playback.at(now_ms);
    if (!this.#isDue && !this.#changed(state) && isFresh === this.#wasFresh && !this.#camera_controller.moves && (moment?.still ?? true)) {
      return;
    }
    if (!isDue(this.#fitted.software, now_ms - this.#drawn_ms, isGridSeen(state) ? this.#held_ms : 0)) {
      return;
    }
    this.#drawn_ms = now_ms;
    this.#held_ms = null;
    this.#isDue = false;
    this.#wasFresh = isFresh;
    this.#state = state;
    this.#dress(state.view.night ? NIGHT : DAY, isFresh || state.frame === null);
    const ratio = this.#fitted.pixelRatio(this.#size.ratio, state.frame?.n ?? 0);
    if (ratio !== this.#fitted.renderer.getPixelRatio()) this.#fitted.renderer.setPixelRatio(ratio);
    this.#overlay.begin();
    this.#show(state, moment, isFresh, now_ms);
    this.#overlay.end();
    this.#fitted.renderer.render(this.#root, this.#eye.camera);
  }

  resize(width: number, height: number, pixelRatio: number): void {
    this.#size = { width, height, ratio: pixelRatio };
    this.#fitted.renderer.setSize(width, height, false);
    this.#drawn_ms = -Infinity; // another size has emptied the picture
    this.#remeasure();
  }

  get isHeld(): boolean {
    return this.#controls.isHeld;
  }

  dispose(): void {
    this.#observer.disconnect();
    for (const each of [
      this.#controls, this.#overlay, this.#box, this.#ground, this.#grid, this.#vehicles, this.#billboards, this.#trails, this.#shell, this.#scenery, this.#dynamicLayer,
      this.#drawn, this.#pads, ...this.#layers, this.#backdrop, this.#fitted.renderer,
    ]) {
      each.dispose();
    }
  }

  #changed(state: State): boolean {
    const last = this.#state;
    return (
      last === null || state.status !== last.status || state.frame !== last.frame || state.preview !== last.preview ||
      state.view !== last.view || state.features !== last.features || state.access !== last.access || state.drawn !== last.drawn ||
      state.placing !== last.placing || state.site !== last.site || state.panels.right !== last.panels.right || state.panels.editing !== last.panels.editing || state.panels.drafts !== last.panels.drafts || (state.drawn?.since_ms ?? null) !== null
    );
  }

  #dress(palette: Palette, isFresh: boolean): void {
    this.#canvas.classList.toggle("stale", !isFresh);
    if (palette === this.#palette) {
      return;
    }
    this.#palette = palette;
    this.#fitted.renderer.setClearColor(new Color().setRGB(...palette.ground, SRGBColorSpace));
    for (const each of [this.#eye, this.#grid, this.#vehicles, this.#billboards, this.#shell, this.#drawn]) {
      each.dress(palette);
    }
  }

  #show(state: State, moment: Moment | null, isFresh: boolean, now_ms: number): void {
    const { status } = state;
    const heading_deg = status?.origin.heading_deg ?? 0;
    const selected = state.view.selected === null ? -1 : indexOf(state, state.view.selected);
    if (moment !== null) {
      this.#poses.set(moment, heading_deg);
    }
    const screen = this.#screen();
    const hand = this.#grip !== null || this.#padGrip !== null || this.#cornerGrip !== null ? "drags" : this.isHeld ? "held" : "none";
    this.#eye.look(this.#camera_controller.at(state, this.#poses, selected, screen, now_ms, hand), screen);
    this.#backdrop.look(this.#eye, this.#palette!);
    this.#ground.draw(status, this.#eye, this.#camera_controller.moves, now_ms, this.#overlay);
    this.#grid.draw(this.#eye, this.#overlay);
    this.#drawn.draw(state.drawn, state.placing, state.page_ms, screen.free);
    this.#pads.draw(state, this.#palette!, this.#eye, this.#overlay);
    this.#overlay.north(north_rad(heading_deg) - this.#eye.pose.azimuth, this.#eye);
    if (moment === null || status === null) {
      return;
    }
    const frame = moment.to;
    const palette = this.#palette!;
    this.#appearance.set(frame, palette, isFresh, this.#selectionOf(state));
    const { tints } = this.#appearance;
    this.#tell(frame.n);
    this.#vehicles.draw(this.#reported, frame.n, screen.free);
    this.#billboards.draw(this.#reported, frame.n, screen.free);
    this.#trails.draw(this.#poses, tints, selected);
    this.#shell.place(this.#poses.center, frame.radius_m, this.#eye);
    this.#scenery.draw(status, frame, this.#poses.time_s, palette, this.#eye);
    this.#scenery.words(status, frame, this.#poses.time_s, this.#eye, this.#overlay);
    const { floor_horizontal_m: horizontal_m, floor_vertical_m: vertical_m } = status.flight_envelope;
    const floor: Floor = { horizontal_m, vertical_m, pad_height_m: PAD_HEIGHT_M };
    const pairs = this.#pairsOf(frame, floor);
    const picture: Picture = { state, frame, poses: this.#poses, pairs, floor, tints, selected, palette, eye: this.#eye };
    this.#dynamicLayer.draw(picture, this.#overlay);
    for (const each of this.#layers) each.draw(state, this.#poses.time_s, palette, this.#eye, this.#overlay);
    if (state.drawn === null) this.#names(state, frame, selected);
  }

  /** Indices of the selected vehicles. */
  #selectionOf(state: State): ReadonlySet<number> {
    const { status, view: { selection } } = state;
    if (selection !== this.#selection.of || status !== this.#selection.status) {
      this.#selection = { of: selection, status, indices: new Set(selection.map((id) => indexOf(state, id))) };
    }
    return this.#selection.indices;
  }

  /** Attributes of each vehicle on the graphics card, shared by everything that is drawn of it. */
  #tell(n: number): void {
    this.#reported.grow(n);
    const { numbers, texture } = this.#reported;
    for (let i = 0; i < n; i += 1) {
      numbers.set(this.#poses.place.subarray(4 * i, 4 * i + 4), 4 * REPORTED * i);
      numbers.set(this.#appearance.tints.subarray(4 * i, 4 * i + 4), 4 * REPORTED * i + 4);
      numbers[4 * REPORTED * i + 8] = this.#appearance.marks[i]!;
      numbers[4 * REPORTED * i + 9] = this.#appearance.forms[i]!;
    }
    texture.needsUpdate = n > 0;
  }

  #pairsOf(frame: Frame, floor: Floor): readonly Pair[] {
    if (frame !== this.#pairs.of) {
      this.#pairs = { of: frame, list: closePairs(frame, floor) };
    }
    return this.#pairs.list;
  }

  #names(state: State, frame: Frame, selected: number): void {
    const vehicles = state.status!.vehicles;
    const put = (i: number, manner: "name" | "selected"): void => {
      const id = tail(vehicles[i]?.id ?? "", NAME_LETTERS);
      if (id !== "" && this.#poses.known(i)) {
        const text = manner === "selected" ? texts.scene.height(id, frame.height_m[i]!.toFixed(1)) : id;
        this.#overlay.put(this.#eye, placeOf(this.#poses, i), text, manner, manner === "selected" ? -44 : -26);
      }
    };
    if (frame.n <= NAMED_UP_TO) {
      for (let i = 0; i < frame.n; i += 1) {
        if (i !== selected) {
          put(i, "name");
        }
      }
    } else if (this.#hovered >= 0 && this.#hovered !== selected) {
      put(this.#hovered, "name");
    }
    const others = [...this.#selectionOf(state)].filter((i) => i !== selected);
    if (frame.n > NAMED_UP_TO && others.length < NAMED_UP_TO) {
      for (const i of others) {
        put(i, "name");
      }
    }
    if (selected >= 0) {
      put(selected, "selected");
    }
    if (may(state, "operate") && state.status!.replay === null && this.#poses.center !== null && state.preview?.kind !== "radius") {
      const text = texts.scene.radius(frame.radius_m.toFixed(1));
      this.#overlay.put(this.#eye, handleOf(this.#poses.center, frame.radius_m, this.#eye.basis), text, "handle");
    }
  }

  #screen(): Screen {
    this.#measured ??= screenOf(this.#canvas, this.#size.width, this.#size.height);
    return this.#measured;
  }

  #remeasure(): void {
    this.#measured = null;
    this.#isDue = true;
  }

  #ray(px: number, py: number): Ray {
    return rayThrough(this.#eye.basis, this.#eye.pose, this.#eye.screen, px, py);
  }

  #vehicleAt(px: number, py: number): number {
    const { basis, pose, screen } = this.#eye;
    return nearestPlace(basis, pose, screen, this.#poses.place, this.#poses.n, px, py, PICK_PX);
  }

  #questionAt(px: number, py: number): Question | undefined {
    return this.#layers.flatMap((each) => each.questionAt(px, py, this.#eye) ?? [])[0];
  }

  #hands() {
    return {
      grab: (px: number, py: number): boolean => {
        const ray = this.#ray(px, py);
        this.#padGrip = this.#state === null ? null : padGripAt(this.#state, this.#eye, ray, px, py);
        this.#cornerGrip = this.#state === null || this.#padGrip !== null ? null : cornerGripAt(this.#state, this.#eye, ray, px, py);
        if (this.#cornerGrip !== null) {
          this.#drags += 1;
          if (!this.#cornerGrip.isSide) this.#on.site({ kind: "site-choose", area: this.#cornerGrip.area, corner: this.#cornerGrip.corner });
          return true;
        }
        this.#grip = this.#state === null || this.#padGrip !== null ? null : gripAt(this.#state, this.#eye, ray, px, py);
        return this.#grip !== null || this.#padGrip !== null;
      },
      drag: (px: number, py: number): void => {
        if (this.#padGrip !== null) {
          this.#on.place(padsMoved(this.#padGrip, this.#eye, this.#ray(px, py)));
        }
        if (this.#cornerGrip !== null) {
          this.#dragCorner(this.#cornerGrip, this.#ray(px, py));
        }
        if (this.#grip !== null) {
          this.#tellOf(moved(this.#grip, this.#poses.center, this.#eye, this.#ray(px, py)));
        }
      },
      drop: (): void => {
        this.#grip = this.#padGrip = this.#cornerGrip = null;
      },
      click: (px: number, py: number, keys: Keys): void => {
        const placed = this.#state === null ? null : placedAt(this.#state, this.#eye, this.#ray(px, py));
        if (placed !== null) {
          return this.#tellOf(placed);
        }
        const id = this.#state?.status?.vehicles[this.#vehicleAt(px, py)]?.id;
        const isMore = keys.shift || keys.ctrl;
        if (id !== undefined) {
          this.#on.choose(isMore ? { how: "toggle", id } : { how: "only", ids: [id] });
        } else if (!isMore) {
          const question = this.#questionAt(px, py);
          if (question !== undefined) return this.#on.ask(question);
          this.#on.choose({ how: "only", ids: [] }); // beside every vehicle: a missed shift-click loses nothing
        }
      },
      box: (rect: Rect | null): void => this.#box.show(rect),
      boxed: (rect: Rect, adds: boolean): void => {
        const { basis, pose, screen } = this.#eye;
        const vehicles = this.#state?.status?.vehicles ?? [];
        const found = placesWithin(basis, pose, screen, this.#poses.place, this.#poses.n, rect);
        this.#on.choose({ how: adds ? "add" : "only", ids: found.flatMap((i) => vehicles[i]?.id ?? []) });
      },
      hover: (px: number, py: number): void => {
        if (this.#state === null) {
          return;
        }
        const i = this.#vehicleAt(px, py);
        this.#isDue = this.#isDue || i !== this.#hovered;
        this.#hovered = i;
        const ray = this.#ray(px, py);
        const isPad = padGripAt(this.#state, this.#eye, ray, px, py) !== null;
        const isGrip = isPad || cornerGripAt(this.#state, this.#eye, ray, px, py) !== null || (i < 0 && gripAt(this.#state, this.#eye, ray, px, py) !== null);
        this.#canvas.style.cursor = isUnplaced(this.#state) ? "crosshair" : isGrip ? "grab" : i >= 0 || this.#questionAt(px, py) !== undefined ? "pointer" : "";
      },
      leave: (): void => {
        this.#hovered = -1;
        this.#isDue = true;
      },
      turn: (right: number, up: number): void => this.#move(() => this.#camera_controller.turn(right, up)),
      pan: (right: number, up: number): void => this.#move(() => this.#camera_controller.pan(right, up)),
      zoom: (factor: number): void => this.#move(() => this.#camera_controller.zoom(factor)),
      frame: (): void => this.#move(() => this.#camera_controller.frame()),
    };
  }

  /** All of one drag is one step to be undone, with the corner that it adds. */
  #dragCorner(grip: CornerGrip, ray: Ray): void {
    const place = cornerMoved(grip, this.#eye, ray);
    if (place === null) return;
    const { area, corner, isSide } = grip;
    const gesture = `drag:${this.#drags}`;
    if (isSide) {
      this.#on.site({ kind: "site-step", step: { what: "add", area, corner }, gesture });
      this.#cornerGrip = { ...grip, corner: corner + 1, isSide: false };
    }
    this.#on.site({ kind: "site-step", step: { what: "move", area, corner: isSide ? corner + 1 : corner, ...place }, gesture });
  }

  #tellOf(dragged: Dragged): void {
    if (dragged.kind === "box") {
      this.#on.shape(dragged.id, dragged.change);
    } else {
      this.#on.preview(dragged);
    }
  }

  #move(by: () => void): void {
    by();
    this.#isDue = true;
  }
}
