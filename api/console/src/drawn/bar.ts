/** The preview of a drawn show: play, pause, scrub, close. It takes the place of the timeline; nothing of it flies. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PanelActions } from "../panels/actions";
import { button } from "../panels/controls";
import { minutes } from "../panels/format";
import { icon } from "../panels/icons";
import type { State } from "../state";
import { texts } from "../texts";
import { courseView } from "../timeline/course";
import { drawnCourse } from "../timeline/model";
import { cueAt, shown_s } from "./model";

const t = texts.drawn;

export function drawnBar(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const preview = state.drawn;
  if (preview === null) return nothing;
  const { drawing } = preview;
  const now_s = shown_s(preview, state.page_ms);
  const plays = preview.since_ms !== null;
  const where = texts.replay.of(minutes(now_s), minutes(drawing.duration_s));
  return html`<section class="replay drawn" aria-label=${t.title} data-testid="drawn">
    ${button(actions, {
      id: "drawn-play",
      label: plays ? texts.replay.pause : texts.replay.play,
      icon: plays ? "pause" : "start",
      kind: "primary",
      press: () => actions.dispatch({ kind: "drawn-plays", plays: !plays }),
    })}
    <div class="scrub">
      <span class="scrub-label">
        <strong data-testid="drawn-label">${icon("info")} ${t.label(drawing.show)}</strong>
        <span class="dim" data-testid="drawn-cue">${cueAt(drawing, now_s)}</span>
      </span>
      <span class="value" data-testid="drawn-position">${where}</span>
      ${courseView(drawnCourse(drawing, now_s), {
        slider: { id: "drawn-scrubber", label: t.position, where, moved: (at_s) => actions.dispatch({ kind: "drawn-sought", at_s }) },
      })}
    </div>
    ${button(actions, { id: "drawn-close", label: t.close, icon: "cross", iconOnly: true, press: () => actions.dispatch({ kind: "drawn", drawing: null }) })}
  </section>`;
}
