"""The site in the console: drawn, edited by pointer and by keys, undone, refused in words, stored."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from gcs.areas.files.site_files import read_site
from gcs.model.lifecycle import ShowPhase
from tests.support import console_states as states
from tests.support.console_bench import SOON_MS, Console, console
from tests.support.console_states import ConsoleState, in_state, served

pytestmark = pytest.mark.soak

WORD_PX = 26.0
"""The word of a chosen corner is so far below it."""

STATE = ConsoleState("site", "site-edit", states.with_site, states.panel("feature-site"))


def places(ui: Console) -> list[str]:
    """What the list of corners says, in its order."""
    return ui.page.locator(".site-corner .value").all_inner_texts()


def became(ui: Console, corner: int, began: list[str], by_m: tuple[float, float]) -> None:
    """Wait until a corner is that far from where it began, along x and y."""
    x_m, y_m = (float(each) for each in re.findall(r"-?[\d.]+", began[corner]))
    text = f"x {x_m + by_m[0]:.1f}, y {y_m + by_m[1]:.1f} m"
    expect(ui.part(f"site-corner-{corner}")).to_contain_text(text, timeout=SOON_MS)


def becomes(ui: Console, count: int) -> list[str]:
    expect(ui.page.locator(".site-corner")).to_have_count(count, timeout=SOON_MS)
    return places(ui)


def drag_chosen(ui: Console, by_px: tuple[int, int]) -> None:
    """Pull the chosen corner by what is drawn 26 pixels above its word, until it is elsewhere."""
    before = places(ui)

    def pull() -> None:
        box = ui.page.locator(".scene-word.preview").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 - WORD_PX
        mouse = ui.page.mouse
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + by_px[0], y + by_px[1], steps=6)
        mouse.up()

    def is_moved(within_ms: float) -> None:
        ui.page.wait_for_timeout(min(within_ms, 500.0))
        assert places(ui) != before

    ui.until(pull, is_moved)


@pytest.mark.soak
def test_a_site_is_edited_by_hand_refused_and_stored(chrome: Browser, tmp_path: Path) -> None:
    with in_state(chrome, STATE, tmp_path, (1440, 900)) as ui:
        path = tmp_path / "shows" / "field.geojson"
        first = read_site(path)
        ui.says("site", "corner field")
        ui.press("camera-top")
        ui.opens(lambda: ui.press("site-edit"), "site-editor")
        began = becomes(ui, 6)
        ui.page.wait_for_timeout(1500)  # the camera comes to rest
        drag_chosen(ui, (30, 20))
        assert places(ui)[1:] == began[1:]
        ui.press("site-undo")  # the whole drag is one step
        expect(ui.part("site-undo")).to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
        assert places(ui) == began

        corner = ui.part("site-corner-2")
        corner.focus()
        ui.page.keyboard.press("ArrowUp")
        ui.page.keyboard.press("Shift+ArrowRight")
        became(ui, 2, began, by_m=(1.0, 10.0))
        ui.page.keyboard.press("Insert")
        assert len(becomes(ui, 7)) == 7
        expect(ui.part("site-corner-3")).to_be_focused(timeout=SOON_MS)
        ui.page.keyboard.press("Delete")
        becomes(ui, 6)
        ui.page.keyboard.press("Control+z")
        becomes(ui, 7)

        ui.part("site-choose-1").click()
        reaches_up_to(ui, "-5")
        ui.press("site-save")
        ui.says("site-problems", "height_max_m = -5: above height_min_m = 0")
        expect(ui.part("site-choose-1")).to_have_attribute("aria-pressed", "true")
        assert ui.findings() == []
        assert read_site(path) == first
        ui.press("site-undo")
        ui.press("site-save")
        ui.says("site-state", "not the one in force")
        stored = read_site(path)
        assert len(stored.flight_geography.corners) == 7
        assert stored.areas[1:] == first.areas[1:]  # what was not moved is as it was, to the last digit
        assert not [each for each in ui.wrong if "422" not in each]


def areas(ui: Console) -> list[str]:
    """What the list of areas says, in its order."""
    return [each.strip() for each in ui.page.locator(".site-areas .choice").all_inner_texts()]


def listed(ui: Console, *names: str) -> None:
    expect(ui.page.locator(".site-areas .choice")).to_have_count(len(names), timeout=SOON_MS)
    assert areas(ui) == [*names]


def reaches_up_to(ui: Console, metres: str) -> None:
    ui.part("site-greatest").fill(metres)
    ui.part("site-greatest").press("Enter")


def test_areas_are_added_and_removed_and_stored(chrome: Browser, tmp_path: Path) -> None:
    path = tmp_path / "shows" / "field.geojson"
    with (
        served(STATE, tmp_path) as (service, url, _),
        console(chrome, url, width=1440, height=900) as ui,
    ):
        ui.says("connection", "Live")
        STATE.act(ui)
        first = read_site(path)
        ui.says("site", first.digest[:12])
        ui.press("camera-top")
        ui.opens(lambda: ui.press("site-edit"), "site-editor")
        field, people, mast = "flight geography", "audience", "no-fly · mast"
        listed(ui, field, people, mast)

        ui.by_key("site-add-no-fly")  # a square in the field, in the picture; its first corner has the focus
        listed(ui, field, people, mast, "no-fly")
        expect(ui.part("site-choose-3")).to_have_attribute("aria-pressed", "true")
        expect(ui.part("site-corner-0")).to_be_focused(timeout=SOON_MS)
        began = becomes(ui, 4)
        ui.page.wait_for_timeout(1500)  # the camera comes to rest
        drag_chosen(ui, (-12, -9))
        assert places(ui)[1:] == began[1:]
        reaches_up_to(ui, "-5")

        ui.part("site-choose-1").click()
        ui.says("site-area", people)
        ui.by_key("site-area-remove")
        listed(ui, field, mast, "no-fly")
        expect(ui.part("site-area-remove")).to_be_focused()  # the next area is chosen
        ui.press("site-undo")  # a removed area is one step
        listed(ui, field, people, mast, "no-fly")
        ui.part("site-choose-2").click()
        ui.by_key("site-area-remove")
        listed(ui, field, people, "no-fly")

        ui.part("site-choose-0").click()
        ui.press("site-save")
        ui.says("site-problems", "area 3, no-fly 'no-fly': height_max_m = -5: above height_min_m = 0")
        expect(ui.part("site-choose-2")).to_have_attribute("aria-pressed", "true")
        assert ui.findings() == []
        assert read_site(path) == first
        reaches_up_to(ui, "25")

        service.show = ShowPhase.RUNNING  # the console says why not; the service would refuse it
        expect(ui.part("site-save")).to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
        service.show = ShowPhase.IDLE
        ui.press("site-save")
        ui.says("site-state", "not the one in force")
        stored = read_site(path)
        ui.says("site", stored.digest[:12])
        assert stored.digest != first.digest
        assert [(area.name, area.top_m) for area in stored.areas[2:]] == [("no-fly", 25.0)]
        assert stored.areas[:2] == first.areas[:2]
        service.show = ShowPhase.RUNNING
        expect(ui.part("site-edit")).to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
        assert not [each for each in ui.wrong if "422" not in each]
