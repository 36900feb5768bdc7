/** What an operator does in the panels: within the page, or as a call of the service. The views know nothing else. */

import type { Actions, FleetCommand, ReplayChange, ShowCommand, VehicleCommand } from "../actions";
import type { Choice, Selection } from "../selection";
import type { Box } from "../obstacle";
import type { Placement, PreflightReport, State, View } from "../state";
import type { Message } from "../messages";
import type { Alarm } from "../alarms/model";
import type { Sort } from "./rows";
import type { PanelState, Group, LeftPanel, RightPanel, Sheet } from "./state";

/** As a cause of a preflight report has it. */
export type Remedy = NonNullable<PreflightReport["causes"][number]["action"]>;

export type PanelName = LeftPanel | RightPanel;

export interface PanelActions
  extends Pick<Actions, "ask" | "removeObstacle" | "checkShow" | "selectShow" | "deselectShow" | "removeShow" | "seek" | "changeOrbit" | "changeYaw"> {
  /** As it is now: what a view was drawn of may be a tenth of a second old, and keys come faster. */
  now(): State;
  dispatch(message: Message): void;
  view(change: Partial<Omit<View, keyof Selection>>): void;
  set(change: Partial<PanelState>): void;
  draft(field: string, text: string): void;
  undo(prefix: string): void;
  filter(text: string): void;
  sort(sort: Sort): void;
  /** One vehicle, and its page. */
  select(id: string): void;
  /** Change the selection; the panel that is open stays. */
  choose(choice: Choice): void;
  /** In the scene: the table shows what was selected where it is open, else the vehicle's page opens. */
  chooseInScene(choice: Choice): void;
  sheet(sheet: Sheet | null): void;
  openPanel(name: PanelName): void;
  togglePanel(name: PanelName): void;
  edit(obstacle: string | null): void;
  refuse(what: string, why: string): void;
  acknowledge(alarm: string): void;
  acknowledgeAll(): void;
  /** The setting of the alarms' sound. */
  sound(on: boolean): void;

  show(command: ShowCommand): void;
  start(): void;
  /** At the typed time. */
  begin(): void;
  cancelBegin(): void;
  vehicle(id: string, command: VehicleCommand): void;
  /** To every selected vehicle, as one command. */
  fleet(command: FleetCommand): void;
  exclude(id: string): void;
  /** The command with which a preflight report mends a cause. */
  mend(action: Remedy): void;
  /** The command that an alarm advises. */
  follow(alarm: Alarm): void;
  include(id: string): void;
  apply(group: Group): void;
  saveObstacle(): void;
  /** With the hand, in the scene: it is being edited then. */
  shapeObstacle(id: string, change: Partial<Box>): void;
  confirmPreview(): void;
  cancelPreview(): void;
  armKill(vehicles: readonly string[] | null): void;
  confirmTyped(): void;
  holdKill(): void;
  releaseKill(): void;
  disarmKill(): void;
  readPreflight(): void;
  takeLead(): void;
  upload(file: File): void;
  previewShow(name: string): void;
  /** Begin to move and turn a drawn show. */
  placeShow(name: string): void;
  placeAt(place: Placement): void;
  fitPlacement(): void;
  applyPlacement(): void;
  closePlacing(): void;
  saveSite(): void;
  enter(): void;
  replay(change: ReplayChange): void;
  readReport(): void;
}
