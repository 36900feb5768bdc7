/** What a feature beside the formation shows: the page asks every one, and names none. What it does not need it leaves out. */

import type { TemplateResult } from "lit-html";
import type { VehicleCommand } from "../actions";
import type { PanelActions } from "../panels/actions";
import type { State, Status } from "../state";

export interface Feature {
  /** Across the page, above the scene; `why`: why nothing can be commanded, "" where it can. */
  strip?(state: State, actions: PanelActions, why: string): TemplateResult | null;
  /** At a glance, beside the scene. */
  glance?(state: State): TemplateResult | null;
  /** Whether what it reports is read once a second. */
  isRead?(status: Status): boolean;
  /** What a running show is that it lets stand still; "": it does not. */
  halts?(status: Status): string;
  /** What says when the show begins, instead of a time; "": nothing. */
  begins?(status: Status): string;
  /** Why no vehicle can be commanded so; "" where it can. */
  whyNot?(status: Status, command: VehicleCommand): string;
}
