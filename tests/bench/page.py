"""How many pictures a second the console draws without a graphics card, while the service flies beside it.

`make bench` prints it; `python -m tests.bench.page 200` measures one fleet, `python -m tests.bench.page grid`
the fleet as a grid of pills, of a service without vehicles. The alternative beside it is the same page with
its scene hidden: what the browser itself can do here.
"""

import logging
import sys
import time
from itertools import pairwise
from typing import Final

from playwright.sync_api import Page

from tests.bench.viewers import serving
from tests.support.api_background import Ticking, in_background
from tests.support.api_fake_service import FakeService
from tests.support.browsers import GET_ONE, chromium
from tests.support.console_bench import browser

COUNTS: Final = (60, 200, 1000)
LEAST_HZ: Final = {60: 30.0, 200: 30.0, 1000: 5.0}
"""With more vehicles it is usable as long as it follows what an operator does."""

PANELS_COUNT, PANELS_LEAST = 60, 0.8
"""With so many vehicles, pictures a second with both panels open are at least this share of those without."""

GRID: Final = "grid"
GRID_COUNT, GRID_LEAST_HZ, SELECTS_MS = 1000, 20.0, 200.0
"""With so many vehicles as pills: pictures a second, and how long it takes to select all of them."""

PANELS: Final = {"left": "shape", "right": "fleet"}
ROUNDS, ROUND_S = 4, 4.0
"""In turns, so that what else this machine does meets both alike."""

WIDTH_PX, HEIGHT_PX = 1440, 900
SETTLED_S, MEASURED_S = 4.0, 10.0

COUNT: Final = """
window.drawn = [];
const note = (now_ms) => { window.drawn.push(now_ms); requestAnimationFrame(note); };
requestAnimationFrame(note);
"""
SELECTED: Final = """(count) => new Promise((done) => {
  const began_ms = performance.now();
  document.querySelector("[data-testid=filter-select]").click();
  const look = () => {
    const selected = document.querySelectorAll("[role=option][aria-selected=true]");
    if (selected.length < count) requestAnimationFrame(look);
    else requestAnimationFrame(() => done(performance.now() - began_ms));
  };
  requestAnimationFrame(look);
})"""
"""How long after the press all are selected, and painted. ms."""

HIDDEN: Final = "() => document.querySelector('#view').style.setProperty('display', 'none')"


def pictures_hz(
    page: Page, settled_s: float = SETTLED_S, measured_s: float = MEASURED_S
) -> tuple[float, float]:
    """A second, and the longest time between two, in ms."""
    time.sleep(settled_s)
    page.evaluate("() => { window.drawn = []; }")
    time.sleep(measured_s)
    drawn_ms: list[float] = page.evaluate("() => window.drawn")
    gaps_ms = [after - before for before, after in pairwise(drawn_ms)]
    return 1e3 * len(gaps_ms) / sum(gaps_ms), max(gaps_ms)


def show_panels(page: Page, shown: bool) -> None:
    """Both of them, or none."""
    for side, name in PANELS.items():
        close = page.get_by_test_id(f"close-{side}")
        if shown and page.get_by_test_id(f"panel-{name}").count() == 0:
            page.get_by_test_id(f"tab-{name}").click()
        elif not shown and close.count() > 0:
            close.click()


def panels_share(page: Page) -> float:
    """Pictures a second with both panels open, as a share of those with both closed."""
    hz: dict[bool, float] = {False: 0.0, True: 0.0}
    for _ in range(ROUNDS):
        for shown in hz:
            show_panels(page, shown)
            hz[shown] += pictures_hz(page, 1.0, ROUND_S)[0] / ROUNDS
    print(
        f"  both panels open {hz[True]:.1f} pictures a second, closed {hz[False]:.1f}:"
        f" {hz[True] / hz[False]:.2f}"
    )
    return hz[True] / hz[False]


def grid_is_quick() -> bool:
    """The fleet as a grid: pictures a second, and a selection of all."""
    print(f"{GRID_COUNT} vehicles as a grid, {WIDTH_PX}x{HEIGHT_PX}, Chromium without a graphics card")
    service = FakeService(GRID_COUNT)
    service.fly()
    with in_background(Ticking(service)) as port, browser() as chrome:
        page = chrome.new_page(viewport={"width": WIDTH_PX, "height": HEIGHT_PX})
        page.add_init_script(COUNT)
        page.goto(f"http://127.0.0.1:{port}/")
        page.get_by_test_id("fleet-view").click()
        page.get_by_test_id(f"pill-d{GRID_COUNT}").wait_for()
        hz, longest_ms = pictures_hz(page)
        selected_ms = float(page.evaluate(SELECTED, GRID_COUNT))
        page.evaluate(HIDDEN)
        bare_hz, _ = pictures_hz(page)
    good = hz >= GRID_LEAST_HZ and selected_ms <= SELECTS_MS
    print(
        f"  the grid {hz:.1f} pictures a second (longest {longest_ms:.0f} ms),"
        f" its scene hidden {bare_hz:.1f}; all selected in {selected_ms:.0f} ms"
    )
    verdict = "pass" if good else "MISS"
    print(f"    must: {GRID_LEAST_HZ:g} a second, {SELECTS_MS:g} ms: {verdict}", flush=True)
    return good


def tell(count: int) -> bool:
    """Measure one fleet and print it. Returns: whether what must be reached is."""
    print(f"{count} vehicles, {WIDTH_PX}x{HEIGHT_PX}, Chromium without a graphics card")
    with serving(count) as service, browser() as chrome:
        page = chrome.new_page(viewport={"width": WIDTH_PX, "height": HEIGHT_PX})
        page.add_init_script(COUNT)
        page.goto(f"http://127.0.0.1:{service.port}/")
        page.get_by_test_id("row-v1").or_(page.get_by_test_id("fleet-table")).first.wait_for()
        scene_hz, longest_ms = pictures_hz(page)
        part = service.measured()
        share = panels_share(page) if count == PANELS_COUNT else None
        page.evaluate(HIDDEN)
        bare_hz, _ = pictures_hz(page)
    good = scene_hz >= LEAST_HZ[count]
    print(
        f"  the page {scene_hz:.1f} pictures a second (longest {longest_ms:.0f} ms),"
        f" its scene hidden {bare_hz:.1f}"
    )
    print(
        f"  the service meanwhile {part.core_percent:.1f} % of a core, lateness p99 {part.late_p99_ms:.1f} ms"
    )
    print(f"    must: {LEAST_HZ[count]:g} a second: {'pass' if good else 'MISS'}", flush=True)
    if share is not None:
        enough = share >= PANELS_LEAST
        print(f"    must: {PANELS_LEAST:g} of them: {'pass' if enough else 'MISS'}", flush=True)
        good = good and enough
    return good


def main(desired: list[str]) -> None:
    """The table."""
    logging.disable(logging.WARNING)
    if chromium() is None:
        print(f"the page was not measured: there is no Chromium here. To get one: {GET_ONE}")
        return
    reached = [tell(int(each)) for each in desired or COUNTS if each != GRID]
    if not desired or GRID in desired:
        reached.append(grid_is_quick())
    if not all(reached):
        print("not reached: page")


if __name__ == "__main__":
    main(sys.argv[1:])
