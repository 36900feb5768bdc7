"""The fleet as a grid of pills: selected by a box, by typing and by keyboard."""

from collections.abc import Iterator
from functools import partial

import pytest
from playwright.sync_api import Browser, expect

from tests.support.api_background import Ticking, in_background
from tests.support.api_fake_service import FakeService
from tests.support.console_bench import Console, console

PILLS = "(pills) => pills.filter((pill) => pill.ariaSelected === 'true').map((pill) => pill.textContent)"
COUNT = 130


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """Of a service whose vehicles fly in formation."""
    service = FakeService(COUNT)
    service.fly()
    with in_background(Ticking(service)) as port:
        yield f"http://127.0.0.1:{port}"


def selected(ui: Console) -> set[str]:
    return set(ui.page.locator("[role=option]").evaluate_all(PILLS))


def box(ui: Console, first: str, last: str, *keys: str) -> None:
    """Drag from one pill to another."""
    at = [ui.part(f"pill-{name}").bounding_box() for name in (first, last)]
    (x, y), (to_x, to_y) = ((each["x"] + 4.0, each["y"] + 8.0) for each in at if each is not None)
    for key in keys:
        ui.page.keyboard.down(key)
    ui.page.mouse.move(x, y)
    ui.page.mouse.down()
    ui.page.mouse.move(to_x + 8.0, to_y, steps=4)
    ui.page.mouse.up()
    for key in keys:
        ui.page.keyboard.up(key)


@pytest.mark.soak
def test_pills_are_selected_by_box_typing_and_keys(chrome: Browser, url: str) -> None:
    with console(chrome, url, width=1440, height=900) as ui:
        ui.says("connection", "Live")
        ui.opens(lambda: ui.press("fleet-view"), "fleet-grid")
        expect(ui.page.get_by_role("option")).to_have_count(COUNT)

        def selects(act: partial[None], *names: str) -> None:
            ui.until(act, lambda ms: ui.says("selection-count", f"{len(names)} vehicle", ms))
            assert selected(ui) == set(names)

        selects(partial(box, ui, "d2", "d4"), "d2", "d3", "d4")
        selects(partial(box, ui, "d6", "d7", "Shift"), "d2", "d3", "d4", "d6", "d7")
        ui.part("filter").fill("100-110")
        ui.page.keyboard.press("Enter")
        ui.says("selection-count", "11 vehicles")
        ui.part("filter").fill("")
        ui.part("pill-d1").click()
        ui.says("selection-count", "1 vehicle")
        for key in ("ArrowRight", "Shift+ArrowRight"):
            ui.part("fleet-grid").press(key)
        ui.says("selection-count", "2 vehicles")
        assert selected(ui) == {"d2", "d3"}
        ui.part("fleet-grid").press("Control+a")
        ui.says("selection-count", f"{COUNT} vehicles")
        assert ui.wrong == []


@pytest.mark.soak
@pytest.mark.parametrize(("width", "height"), [(360, 640), (390, 844), (1024, 768), (2560, 1440)])
def test_grid_fits_every_window(chrome: Browser, url: str, width: int, height: int) -> None:
    with console(chrome, url, width=width, height=height) as ui:
        ui.says("connection", "Live")
        if ui.part("panel-fleet").count() == 0:
            ui.opens(lambda: ui.press("tab-fleet"), "panel-fleet")
        ui.opens(lambda: ui.press("fleet-view"), "fleet-grid")
        ui.settles("document.scrollingElement.scrollWidth <= innerWidth", at=True)
        ui.part(f"pill-d{COUNT}").scroll_into_view_if_needed()
        expect(ui.part(f"pill-d{COUNT}")).to_be_in_viewport()
        assert ui.wrong == []
