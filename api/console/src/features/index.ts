/** The features of this page. A new one is its module, and its name here. */

import type { VehicleCommand } from "../actions";
import type { State, Status } from "../state";
import { corrections } from "./corrections";
import type { Feature, FeaturePanel } from "./feature";
import { fences } from "./fences";
import { go } from "./go";
import { lights } from "./lights";
import { remoteId } from "./remoteId";
import { site } from "./site";
import { targets } from "./targets";
import { timecode } from "./timecode";
import { traffic } from "./traffic";
import { wind } from "./wind";

export const features: readonly Feature[] = [go, timecode, corrections, targets, traffic, fences, remoteId, wind, site, lights];

/** Panels of those that are configured. */
export const panelsOf = (status: Status | null): readonly FeaturePanel[] =>
  features.flatMap(({ panel, isRead }) => (panel && status && isRead?.(status) ? [panel] : []));

const first = (status: Status | null, word: (feature: Feature, status: Status) => string | undefined): string =>
  status === null ? "" : (features.map((each) => word(each, status)).find((found) => found) ?? "");

/** What a running show is that stands still; "": it does not. */
export const halted = (status: Status | null): string => first(status, (each, now) => each.halts?.(now));

/** What says when the show begins, instead of a time; "": nothing. */
export const begunBy = (status: Status | null): string => first(status, (each, now) => each.begins?.(now));

/** Why no vehicle can be commanded so; "" where it can. */
export const whyNoFeature = ({ status }: State, command: VehicleCommand): string => first(status, (each, now) => each.whyNot?.(now, command));
