/** A record, played: play, speed, where in it. It takes the place of the big buttons. */

import { html, nothing, type TemplateResult } from "lit-html";
import type { PanelActions } from "../panels/actions";
import { button, choices } from "../panels/controls";
import { minutes } from "../panels/format";
import { icon } from "../panels/icons";
import type { ReplayChange } from "../actions";
import type { Status, State } from "../state";
import { texts } from "../texts";
import { courseView, marked, markText, nameOf, partAt } from "../timeline/course";
import { recordCourse } from "../timeline/model";

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

export function replayBar(state: State, actions: PanelActions): TemplateResult | typeof nothing {
  const replay = state.status?.replay;
  if (!replay) return nothing;
  const stands = replay.paused || replay.ended;
  const dragged = state.panels.drafts["scrubber"];
  const shown_s = dragged === undefined ? position_s(state) : Number(dragged);
  const { marks } = state;
  const show = state.status?.show.selected;
  const course = recordCourse(marks, shown_s, replay.duration_s);
  const now = partAt(course, shown_s);
  const where = t.of(minutes(shown_s), minutes(replay.duration_s));
  const speed = String(replay.speed);
  const speeds = SPEEDS.includes(speed) ? SPEEDS : [...SPEEDS, speed];
  const jump = (id: string, label: string, name: string, by_s: number): TemplateResult =>
    button(actions, { id, label, name, press: () => actions.replay({ position_s: jumped_s(state, by_s) }) });
  return html`<section class="replay record" aria-label=${t.title} data-testid="replay">
    ${button(actions, {
      id: "replay-play",
      label: stands ? t.play : t.pause,
      icon: stands ? "start" : "pause",
      kind: "primary",
      press: () => actions.replay(played(replay)),
    })}
    ${jump("replay-back", "−10 s", t.back, -JUMP_S)} ${jump("replay-on", "+10 s", t.on, JUMP_S)}
    <div class="scrub">
      <span class="scrub-label"><strong data-testid="replay-label">${icon("resume")} ${t.label}</strong> <span class="dim" data-testid="replay-file" title=${replay.file}>${replay.file}</span>
        ${show ? html`<span class="dim" data-testid="timeline-show">${show.name}</span>` : nothing} <span data-testid="timeline-cue">${now && nameOf(now)}</span></span>
      <span class="value" data-testid="replay-position">${where}</span>
      ${marks?.phases.length === 0 ? html`<span class="dim unmarked" data-testid="replay-unmarked">${t.unmarked}</span>` : nothing}
      ${courseView(course, {
        marks: marked(
          state,
          actions,
          ({ at_s }) => actions.replay({ position_s: at_s }),
          (mark) => `${texts.timeline.goTo(minutes(mark.at_s))}: ${markText(mark)}`,
        ),
        slider: {
          id: "replay-scrubber",
          label: t.position,
          where: [where, now && nameOf(now)].filter(Boolean).join(", "),
          moved(at_s, isDone) {
            actions.draft("scrubber", String(at_s)); // until the service has it: a further key goes on from there
            if (isDone) actions.replay({ position_s: at_s });
          },
        },
      })}
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
