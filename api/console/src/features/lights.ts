/** The vehicles' own lights: `find` lets them blink. */

import type { Feature } from "./feature";

export const t = {
  noLights: "No lights are sent: lights.driver of the configuration is none",
};

export const lights: Feature = {
  whyNot: ({ features }, command) => (command === "find" && features.lights?.driver === "none" ? t.noLights : ""),
};
