// What a service says, for tests; each field as the types demand.

import type { Command, FrameColumn, Status } from "../src/state";

const NAMES = [
  "x_m", "y_m", "height_m", "vx_m_s", "vy_m_s", "vup_m_s", "heading_deg", "setpoint_x_m_s", "setpoint_y_m_s", "setpoint_up_m_s",
  "low_s", "empty_s", "battery", "uncertainty_m",
] as const;

/** Of the frames that `frames.ts` writes. */
export const COLUMNS: readonly FrameColumn[] = [
  ...NAMES.map((name) => ({ name, unit: "", label: "" })),
  { name: "position_age_s", unit: "s", label: "Position age" },
  { name: "heartbeat_age_s", unit: "s", label: "Heartbeat age" },
  { name: "link_quality", unit: "share", label: "Link quality" },
];

export function status(change: Partial<Status> = {}): Status {
  return {
    revision: 1, time_s: 10, unix_time_s: 1_790_000_000, began_unix_time_s: 1_789_999_990, control_reason: "",
    counts: { airborne: 2, controlled: 2, uncontrolled: 0, unknown: 0, on_ground: 0, offline: 0 },
    stations: [], show: { phase: "running", reason: "", possible: ["pause", "stop", "abort"], start_refused: "", selected: null, start_unix_time_s: null, countdown_s: null },
    timeline: [], shows_refused: "", features: { corrections: null, timecode: null, targets: null, traffic: null, tak: null, fences: null, remote_id: null, wind: null, go: null, site: null, lights: { driver: "led-control", sent: 0, dropped: 0 } },
    origin: { latitude_deg: 47.4, longitude_deg: 8.5, altitude_amsl_m: 488, heading_deg: 0 }, map: null,
    formation: { radius_m: 10, height_m: 20, law: "slots", radius_now_m: 10, height_now_m: 20 },
    target: {
      x_m: 0, y_m: 0, velocity_x_m_s: 0, velocity_y_m_s: 0,
      latitude_deg: 47.4, longitude_deg: 8.5, velocity_north_m_s: 0, height_m: 0, clearance_m: 0, velocity_east_m_s: 0,
    },
    orbit: { radius_m: 15, speed_m_s: 2, direction: "counterclockwise" },
    yaw: { policy: "fixed", heading_deg: 0 },
    obstacles: [], flight_envelope: {
      height_min_m: 3, height_max_m: 100, distance_max_m: 300, floor_horizontal_m: 2, floor_vertical_m: 3.2, margin_m: 0.5, areas: [],
    },
    interrupted: null, estimates: null, severity: "normal", alarms: [], access: "off", limits: [], replay: null, events: [], columns: [...COLUMNS],
    vehicles: [{ id: "d1", system_id: 1, link: "d1", autopilot: "px4", station: null, reason: "", limited_by: "", home: null, fix_type: 3 }],
    ...change,
  };
}

/** Nothing flies. */
export const GROUNDED: Status["counts"] = { airborne: 0, controlled: 0, uncontrolled: 0, unknown: 0, on_ground: 2, offline: 0 };

export const command = (id: string, outcome: Command["outcome"] = "pending"): Command => ({
  id, action: "pause", by: "local", accepted_unix_time_s: 1, outcome, outcomes: {},
});
