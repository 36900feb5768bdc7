// The signs outside the page's own picture: the tab's title and icon, and the sound. Follows the state.

import caution from "../icon-caution.svg";
import emergency from "../icon-emergency.svg";
import normal from "../icon.svg";
import warning from "../icon-warning.svg";
import type { State } from "../state";
import { texts } from "../texts";
import { iconOf, isCutOff, titleOf } from "./attention";
import { alarmsOf } from "./model";
import { Sounder } from "./sound";

const ICONS = { normal, caution, warning, emergency } as const;

export interface Signs {
  show(state: State): void;
  /** The page was pressed: sound may be played from now on. */
  touched(): void;
}

export function createSigns(page: Document, blocked: (isBlocked: boolean) => void): Signs {
  const sounder = new Sounder(blocked);
  const icon = page.querySelector<HTMLLinkElement>('link[rel="icon"]')!;
  let rung = 0;
  return {
    show(state) {
      const { status, attention } = state;
      const alarms = alarmsOf(status);
      const isCut = isCutOff(state);
      const title = isCut ? texts.alarms.noData(texts.title) : titleOf(texts.title, alarms);
      if (page.title !== title) page.title = title;
      const href = ICONS[isCut ? "emergency" : iconOf(alarms)];
      if (icon.getAttribute("href") !== href) icon.setAttribute("href", href);
      if (attention.ring.count > rung) sounder.play(attention.ring.severity);
      rung = attention.ring.count;
    },
    touched() {
      sounder.unlock();
    },
  };
}
