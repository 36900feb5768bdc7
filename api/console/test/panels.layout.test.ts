import { describe, expect, it } from "vitest";

import { layoutOf, shownPanels, withLayout, type Layout } from "../src/panels/layout";
import { initialDesk } from "../src/panels/state";

/** Whether a window of this size matches a query, at 16 px to the em. */
const matches = (width: number, height: number) => (query: string): boolean =>
  query.split(", ").some((either) =>
    [...either.matchAll(/\(([a-z-]+): ([\d./]+)(?:em)?\)/g)].every(([, name, value]) => {
      if (name === "max-width") return width <= Number(value) * 16;
      if (name === "max-height") return height <= Number(value) * 16;
      return width >= height; // min-aspect-ratio: 1/1
    }),
  );

const layout = (width: number, height: number): Layout => layoutOf(matches(width, height));

describe("the layout", () => {
  it("follows the window's size, upright and sideways", () => {
    for (const [width, height] of [[360, 640], [390, 844], [768, 1024], [900, 1440]] as const) expect(layout(width, height)).toBe("sheet");
    for (const [width, height] of [[640, 360], [740, 360], [844, 390]] as const) expect(layout(width, height)).toBe("side");
    expect(layout(1024, 768)).toBe("single");
    for (const [width, height] of [[1280, 720], [1440, 900], [2560, 1440], [1440, 2560]] as const) expect(layout(width, height)).toBe("wide");
  });

  it("shows both panels where there is room, else the one opened last", () => {
    const panels = initialDesk();
    expect(shownPanels(panels)).toEqual({ left: "preflight", right: "fleet" });
    expect(shownPanels({ ...panels, layout: "single", front: "right" })).toEqual({ left: null, right: "fleet" });
    expect(shownPanels({ ...panels, layout: "sheet", front: "left" })).toEqual({ left: "preflight", right: null });
  });

  it("covers no scene with a sheet by itself, and forgets no panel by rotation", () => {
    const panels = initialDesk();
    const phone = withLayout(panels, "sheet");
    expect(shownPanels(phone)).toEqual({ left: null, right: null });
    const opened = { ...phone, right: "events" as const, front: "right" as const };
    expect(shownPanels(withLayout(opened, "side"))).toEqual({ left: null, right: "events" });
    expect(shownPanels(withLayout(opened, "wide"))).toEqual({ left: "preflight", right: "events" });
    expect(shownPanels(withLayout(phone, "single"))).toEqual({ left: null, right: "fleet" });
  });
});
