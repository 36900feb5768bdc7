// PROVISIONAL, by hand: what the console's stream says seldom. `schema.ts` has it as soon as the service does.

import type { components } from "./schema";

type Schemas = components["schemas"];

export interface StatusVehicle {
  id: string;
  system_id: number;
  link: string;
  reason: string;
  restrained_by: string;
  home: { x_m: number; y_m: number; height_m: number } | null;
}

export interface StatusEvent {
  number: number;
  unix_time_s: number;
  text: string;
  vehicle: string | null;
  severity: string;
}

export interface Replay {
  file: string;
  speed: number;
  paused: boolean;
  position_s: number;
  duration_s: number;
}

export interface Status {
  revision: number;
  time_s: number;
  unix_time_s: number;
  control_reason: string;
  show: Schemas["Show"];
  timeline: { cue: string; at_s: number }[];
  origin: Schemas["Origin"];
  formation: Schemas["Formation"];
  target: Schemas["Target"];
  orbit: Schemas["Orbit"];
  yaw: Schemas["Yaw"];
  obstacles: Schemas["Obstacle"][];
  fence: { distance_m: number; height_m: number } | null;
  separation: { floor_m: number; vertical_factor: number };
  interrupted: Schemas["Interrupted"] | null;
  notices: string[];
  reactions: Schemas["Reaction"][];
  access: string;
  restraints: string[];
  replay: Replay | null;
  events: StatusEvent[];
  vehicles: StatusVehicle[];
}
