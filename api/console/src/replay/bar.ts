/** A record, played: play, speed, where in it. It takes the place of the big buttons. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PanelActions } from "../panels/actions";
import { button, choices } from "../panels/controls";
import { minutes } from "../panels/format";
import { icon } from "../panels/icons";
import { place } from "../panels/place";
import type { ReplayChange } from "../actions";
import type { Status, State } from "../state";
import { texts } from "../texts";
import { span, ticks } from "./marks";

type Replay = NonNullable<Status["replay"]>;

const t = texts.replay;
const SPEEDS: readonly string[] = ["0.5", "1", "2", "4", "10"];
export const JUMP_S = 10;

/** The replay's position: each frame has its recording time. Pure. */
export function position_s(state: State): number {
  const { frame, status } = state;
  const replay = status?.replay;
  if (!replay) return 0;
  const at_s = frame ? frame.unix_time_s - replay.began_unix_time_s : replay.position_s;
  return Math.min(replay.duration_s, Math.max(0, at_s));
}

export function jumped_s(state: State, by_s: number): number {
  return Math.min(state.status?.replay?.duration_s ?? 0, Math.max(0, position_s(state) + by_s));
}

/** Play, or pause; from the beginning again where the end was reached. Pure. */
export function played(replay: Replay): ReplayChange {
  if (replay.ended) return { position_s: 0, paused: false };
  return { paused: !replay.paused };
}

/** Under the scrubber, to the same scale. */
function band(state: State, actions: PanelActions, duration_s: number): TemplateResult | typeof nothing {
  const { marks } = state;
  if (marks === null || duration_s <= 0) return nothing;
  if (marks.phases.length === 0) return html`<p class="marks-none dim" data-testid="replay-unmarked">${t.unmarked}</p>`;
  return html`<div class="marks" data-testid="replay-marks">
    <div class="marks-phases" aria-hidden="true">
      ${marks.phases.map((each) => {
        const name = texts.phases[each.phase];
        const title = t.phase(name, minutes(each.from_s), minutes(each.until_s));
        return html`<span class="mark-phase phase-${each.phase}" title=${title} ${place({ ...span(each.from_s, each.until_s, duration_s) })}>${name}</span>`;
      })}
      ${marks.idle.map(
        (each) => html`<span class="mark-idle" title=${t.idle} ${place({ ...span(each.from_s, each.until_s, duration_s) })}></span>`,
      )}
    </div>
    ${ticks(marks, duration_s).map(
      (each) => html`<button
        type="button"
        class="mark mark-${each.kind}"
        data-testid="mark-${each.kind}"
        title="${minutes(each.at_s)} ${t.kinds[each.kind]}: ${each.text}"
        aria-label="${t.goTo(minutes(each.at_s))}: ${t.kinds[each.kind]}: ${each.text}"
        ${place({ left: each.left })}
        @click=${() => actions.replay({ position_s: each.at_s })}
      ></button>`,
    )}
  </div>`;
}

export function replayBar(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const replay = state.status?.replay;
  if (!replay) return nothing;
  const stands = replay.paused || replay.ended;
  const dragged = state.panels.drafts["scrubber"];
  const shown_s = dragged === undefined ? position_s(state) : Number(dragged);
  const where = t.of(minutes(shown_s), minutes(replay.duration_s));
  const speed = String(replay.speed);
  const speeds = SPEEDS.includes(speed) ? SPEEDS : [...SPEEDS, speed];
  const jump = (id: string, label: string, name: string, by_s: number): TemplateResult =>
    button(actions, { id, label, name, press: () => actions.replay({ position_s: jumped_s(state, by_s) }) });
  return html`<section class="replay" aria-label=${t.title} data-testid="replay">
    ${button(actions, {
      id: "replay-play",
      label: stands ? t.play : t.pause,
      icon: stands ? "start" : "pause",
      kind: "primary",
      press: () => actions.replay(played(replay)),
    })}
    ${jump("replay-back", "−10 s", t.back, -JUMP_S)} ${jump("replay-on", "+10 s", t.on, JUMP_S)}
    <div class="scrub">
      <span class="scrub-label"><strong data-testid="replay-label">${icon("resume")} ${t.label}</strong> <span class="dim" data-testid="replay-file">${replay.file}</span></span>
      <span class="value" data-testid="replay-position">${where}</span>
      <input
        type="range"
        min="0"
        max=${replay.duration_s}
        step="0.1"
        data-testid="replay-scrubber"
        aria-label=${t.position}
        aria-valuetext=${where}
        .value=${String(shown_s)}
        @input=${(event: Event) => actions.draft("scrubber", (event.target as HTMLInputElement).value)}
        @change=${(event: Event) => {
          actions.undo("scrubber");
          actions.replay({ position_s: Number((event.target as HTMLInputElement).value) });
        }}
      />
      ${band(state, actions, replay.duration_s)}
    </div>
    ${button(actions, {
      id: "replay-skip-idle",
      label: t.skipIdle,
      name: t.skipIdleHint,
      pressed: replay.skips_idle,
      press: () => actions.replay({ skips_idle: !replay.skips_idle }),
    })}
    ${choices("replay-speed", t.speed, speeds.map((value) => ({ value, label: `${value}×` })), speed, (value) =>
      actions.replay({ speed: Number(value) }),
    )}
  </section>`;
}
