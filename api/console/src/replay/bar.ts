/** A record, played: play, speed, where in it. It takes the place of the big buttons. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { DeskActions } from "../desk/actions";
import { button, choices } from "../desk/controls";
import { minutes } from "../desk/format";
import type { ReplayChange } from "../actions";
import type { Status, State } from "../state";
import { texts } from "../texts";

type Replay = NonNullable<Status["replay"]>;

const t = texts.replay;
const SPEEDS: readonly string[] = ["0.5", "1", "2", "4", "10"];
export const JUMP_S = 10;

/** Where the record is now: each frame tells when it was recorded. Pure. */
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

export function replayBar(state: State, actions: DeskActions): TemplateResult | typeof nothing {
  const replay = state.status?.replay;
  if (!replay) return nothing;
  const stands = replay.paused || replay.ended;
  const dragged = state.desk.drafts["scrubber"];
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
      <span class="dim" data-testid="replay-file">${replay.file}</span>
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
    </div>
    ${choices("replay-speed", t.speed, speeds.map((value) => ({ value, label: `${value}×` })), speed, (value) =>
      actions.replay({ speed: Number(value) }),
    )}
  </section>`;
}
