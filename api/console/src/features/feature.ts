/** What a feature beside the formation shows: the page asks every one, and names none. What it does not need it leaves out. */

import type { TemplateResult } from "lit-html";
import type { Group } from "three";
import type { VehicleCommand } from "../actions";
import type { PanelActions } from "../panels/actions";
import type { IconName } from "../panels/icons";
import type { FeaturePanelName } from "../panels/state";
import type { Eye, Shared } from "../scene/camera";
import type { Overlay } from "../scene/overlay";
import type { Palette } from "../scene/palette";
import type { State, Status } from "../state";

/** A panel on the right, offered while what the feature reports is read. */
export interface FeaturePanel {
  name: FeaturePanelName;
  title: string;
  icon: IconName;
  /** `why`: why nothing can be commanded, "" where it can. */
  view(state: State, actions: PanelActions, why: string): TemplateResult;
}

/** What a click in the scene opens, and what then waits for a second press there; "": nothing. */
export interface Question {
  panel: FeaturePanelName;
  sure: string;
}

/** What a feature draws into the scene. */
export interface FeatureLayer {
  /** As it is at `time_s`, the service's clock of what the scene shows. */
  draw(state: State, time_s: number, palette: Palette, eye: Eye, overlay: Overlay): void;
  /** Of what is drawn at a point of the screen; null: nothing is. */
  questionAt(px: number, py: number, eye: Eye): Question | null;
  dispose(): void;
}

export interface Feature {
  /** Across the page, above the scene; `why`: why nothing can be commanded, "" where it can. */
  strip?(state: State, actions: PanelActions, why: string): TemplateResult | null;
  /** At a glance, beside the scene. */
  glance?(state: State): TemplateResult | null;
  panel?: FeaturePanel;
  layer?(shared: Shared, into: Group): FeatureLayer;
  /** Whether what it reports is read once a second. */
  isRead?(status: Status): boolean;
  /** What a running show is that it lets stand still; "": it does not. */
  halts?(status: Status): string;
  /** What says when the show begins, instead of a time; "": nothing. */
  begins?(status: Status): string;
  /** Why no vehicle can be commanded so; "" where it can. */
  whyNot?(status: Status, command: VehicleCommand): string;
}
