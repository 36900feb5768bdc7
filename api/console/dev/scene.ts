// The scene alone, fed with made-up frames; for looking at it and for measuring it. Not part of the page that is built.
// `npx vite`, then /dev/scene.html?n=200&night=0&camera=top&selected=d3&ghost=radius&lit=0&still=1&padding=60px_360px_120px_0

import { Object3D } from "three";

import { createScene } from "../src/scene/index";
import { FLAG, PHASES, initial, type Camera, type Frame, type Preview, type State, type Status } from "../src/state";

const groups = new Set<Object3D>(); // for a profile: what is drawn, to be hidden part by part
const { add } = Object3D.prototype;
Object3D.prototype.add = function (...parts: Object3D[]) {
  groups.add(this);
  return add.apply(this, parts);
};
Object.defineProperty(window, "groups", { get: () => [...groups] });

const asked = new URLSearchParams(location.search);
const n = Number(asked.get("n") ?? 8);
const radius_m = Number(asked.get("radius") ?? Math.max(15, 1.9 * Math.sqrt(n) + 6));
const height_m = radius_m + 10;
const PERIOD_MS = 100;
const side = Math.ceil(Math.sqrt(n));
const orbit_m = Number(asked.get("orbit") ?? 12);

const columns = (): Float32Array => new Float32Array(n);
const bytes = (): Uint8Array => new Uint8Array(n);

/** Points spread over the sphere, which turns; its centre goes round the target. */
function placeAt(i: number, time_s: number, center: readonly number[]): [number, number, number] {
  const h = 1 - (2 * (i + 0.5)) / n;
  const turn = i * 2.399963 + 0.12 * time_s;
  const r = radius_m * Math.sqrt(1 - h * h);
  return [center[0]! + r * Math.cos(turn), center[1]! + r * Math.sin(turn), center[2]! + radius_m * h];
}

const padOf = (i: number): [number, number] => [5 * (Math.floor(i / side) - side / 2) - 20, 5 * ((i % side) - side / 2)];

function hue(turn: number): [number, number, number] {
  const at = (k: number): number => Math.round(255 * Math.min(1, Math.max(0, Math.abs(((turn * 6 + k) % 6) - 3) - 1)));
  return [at(0), at(4), at(2)];
}

function frameAt(time_s: number): Frame {
  const orbit = 0.12 * time_s;
  const center: [number, number, number] = [6 + orbit_m * Math.cos(orbit), 4 + orbit_m * Math.sin(orbit), height_m];
  const frame: Frame = {
    revision: 1, time_s, unix_time_s: 1.79e9 + time_s, received_ms: performance.now(), n, controlAlive: true, showPhase: "running",
    center_m: center, target_m: [6, 4], radius_m, minimumSeparation_m: 3,
    tick: { rate_hz: 20, count: 1, missed: 0, p50_ms: 1, p99_ms: 2, lateness_p99_ms: 1 },
    setpointsSent: 0, interventions: 0, clock_s: time_s, countdown_s: NaN,
    x_m: columns(), y_m: columns(), height_m: columns(), vx_m_s: columns(), vy_m_s: columns(), vup_m_s: columns(), heading_deg: columns(),
    setpoint_x_m_s: columns(), setpoint_y_m_s: columns(), setpoint_up_m_s: columns(), battery: columns(), position_age_s: columns(),
    heartbeat_age_s: columns(), uncertainty_m: columns(), link_quality: columns(), phase: bytes(), mode: bytes(), landed: bytes(),
    flags: bytes(), red: bytes(), green: bytes(), blue: bytes(),
  };
  const lit = asked.get("lit") !== "0";
  for (let i = 0; i < n; i += 1) {
    const [x, y, h] = placeAt(i, time_s, center);
    const next = placeAt(i, time_s + 0.1, [6 + orbit_m * Math.cos(orbit + 0.012), 4 + orbit_m * Math.sin(orbit + 0.012), height_m]);
    frame.x_m[i] = x;
    frame.y_m[i] = y;
    frame.height_m[i] = h;
    frame.vx_m_s[i] = (next[0] - x) * 10;
    frame.vy_m_s[i] = (next[1] - y) * 10;
    frame.setpoint_x_m_s[i] = frame.vx_m_s[i]!;
    frame.setpoint_y_m_s[i] = frame.vy_m_s[i]!;
    frame.heading_deg[i] = (Math.atan2(y - center[1], x - center[0]) * 180) / Math.PI;
    frame.phase[i] = PHASES.indexOf("formation");
    frame.flags[i] = FLAG.armed | FLAG.commanded | (lit ? FLAG.lit : 0);
    [frame.red[i], frame.green[i], frame.blue[i]] = hue((i / n + 0.03 * time_s) % 1);
  }
  if (asked.has("mixed")) {
    PHASES.forEach((phase, k) => {
      if (k < n) {
        frame.phase[k] = PHASES.indexOf(phase);
        frame.flags[k] = phase === "formation" ? FLAG.limited : 0;
        if (["offline", "standby", "killed"].includes(phase)) {
          [frame.x_m[k], frame.y_m[k]] = padOf(k);
          frame.height_m[k] = 0;
        }
      }
    });
    frame.position_age_s[3] = 4;
    if (n > 5) {
      frame.x_m[5] = frame.x_m[4]! + 1.6;
      frame.y_m[5] = frame.y_m[4]! + 0.4;
      frame.height_m[5] = frame.height_m[4]! + 0.4;
    }
  }
  return frame;
}

const status = {
  revision: 1, time_s: 0, unix_time_s: 0, control_reason: "", timeline: [], severity: "normal", alarms: [], access: "", limits: [], events: [],
  origin: { latitude_deg: 47.4, longitude_deg: 8.5, altitude_amsl_m: 488, heading_deg: Number(asked.get("heading") ?? 0) },
  formation: { radius_m, height_m, radius_now_m: radius_m, height_now_m: height_m },
  target: { x_m: 6, y_m: 4 }, orbit: { radius_m: orbit_m, speed_m_s: 2, direction: "clockwise" }, yaw: { policy: "fixed", heading_deg: 0 },
  obstacles: [
    { id: "tower", x_m: 40, y_m: 34, half_length_x_m: 5, half_length_y_m: 4, height_m: 22, velocity_x_m_s: 0, velocity_y_m_s: 0 },
    { id: "hall", x_m: -4, y_m: -44, half_length_x_m: 9, half_length_y_m: 6, height_m: 8, velocity_x_m_s: 0, velocity_y_m_s: 0 },
  ],
  flight_envelope: {
    height_min_m: 3, height_max_m: 100, distance_max_m: 300, floor_horizontal_m: 2, floor_vertical_m: 3, margin_m: 0.3, areas: [],
  },
  interrupted: null, replay: null,
  vehicles: Array.from({ length: n }, (_, i) => {
    const [x_m, y_m] = padOf(i);
    return { id: `d${i + 1}`, system_id: i + 1, link: "fake", autopilot: "px4", reason: "", limited_by: "", home: { x_m, y_m, height_m: 0 } };
  }),
} as unknown as Status;

const PREVIEWS: Record<string, Preview> = {
  target: { kind: "target", x_m: 22, y_m: -8 },
  radius: { kind: "radius", radius_m: radius_m + 5 },
  obstacle: { kind: "obstacle", id: "tower", x_m: 44, y_m: 18 },
  "new-obstacle": { kind: "new-obstacle", x_m: 30, y_m: -20, half_length_x_m: 4, half_length_y_m: 3, height_m: 12 },
};

let state: State = {
  ...initial(performance.now()),
  connection: { kind: "live", since_ms: 0, reason: "" },
  access: { who: "local", rights: new Set(["watch", "operate", "emergency"]) },
  status,
  preview: PREVIEWS[asked.get("preview") ?? ""] ?? null,
};
state = {
  ...state,
  view: { ...state.view, camera: (asked.get("camera") as Camera) ?? "orbit", night: asked.get("night") !== "0", selected: asked.get("selected") },
};
document.documentElement.dataset["look"] = state.view.night ? "night" : "day";
document.querySelector<HTMLElement>("#scene")!.style.padding = (asked.get("padding") ?? "0").replaceAll("_", " ");

const scene = createScene(document.querySelector<HTMLCanvasElement>("#view")!, {
  preview: (preview) => (state = { ...state, preview }),
  select: (selected) => (state = { ...state, view: { ...state.view, selected } }),
});
const fit = (): void => scene.resize(innerWidth, innerHeight, devicePixelRatio);
addEventListener("resize", fit);
fit();

const measured = { frames: 0, draw_ms: 0, from_ms: performance.now(), state: () => state, set: (change: Partial<State>) => (state = { ...state, ...change }) };
Object.assign(window, { measured });
const begun_ms = performance.now();
const feed = (): void => {
  const frame = frameAt(100 + (performance.now() - begun_ms) / 1000);
  state = { ...state, previous: state.frame, frame };
};
feed();
if (!asked.has("still")) {
  setInterval(feed, PERIOD_MS);
}
const loop = (now_ms: number): void => {
  state = { ...state, page_ms: performance.now() };
  const from = performance.now();
  scene.draw(state, now_ms);
  measured.draw_ms += performance.now() - from;
  measured.frames += 1;
  requestAnimationFrame(loop);
};
requestAnimationFrame(loop);
