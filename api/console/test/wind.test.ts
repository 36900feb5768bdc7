/** The measured wind at a glance. */

import { describe, expect, it } from "vitest";
import { t, wind } from "../src/features/wind";
import type { Features } from "../src/state";
import { live } from "./pages";
import { textOf } from "./pressing";
import { status } from "./statuses";

const MEASURED: NonNullable<Features["wind"]> = {
  speed_m_s: 5.2, from_deg: 40.4, deviation_m_s: 0.8, with_gusts_m_s: 7.1, at_least_m_s: 3.6, allowed_m_s: 8,
  greatest_m_s: 7.3, drag_per_s: 0.3, vehicles: 4, why_unknown: "",
};

function glance(found: Partial<typeof MEASURED>): string {
  const now = status({});
  const features = { ...now.features, wind: { ...MEASURED, ...found } } as Features;
  return textOf(wind.glance!(live({ status: { ...now, features } })));
}

describe("the measured wind", () => {
  it("says how much, from where, with gusts, and what is allowed", () => {
    expect(glance({})).toContain("5.2 m/s from 040°, gusts to 7.1, allowed 8");
    expect(glance({})).not.toContain("stopped");
  });

  it("stands out where it is more than allowed, or surely is", () => {
    expect(glance({ with_gusts_m_s: 8.4 })).toContain("stopped");
    expect(glance({ speed_m_s: null, with_gusts_m_s: null, at_least_m_s: 9 })).toContain("stopped");
  });

  it("is named as not known, with the reason, where it is not", () => {
    const text = glance({ speed_m_s: null, with_gusts_m_s: null, at_least_m_s: 0, why_unknown: "it hovers" });
    expect(text).toContain(t.unknown);
    expect(text).toContain("it hovers");
  });

  it("is not there while no vehicle measures it", () => {
    expect(glance({ vehicles: 0 })).not.toContain("allowed");
  });
});
