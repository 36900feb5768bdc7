"""A crew flies a show by the page alone, by hand and by keys; what it does is seen in the service."""

import re
from pathlib import Path

import pytest
from console_bench import FLIGHT_MS, SOON_MS, Console, Station, chromes, console, station
from ground import SOON_S, wait_until
from playwright.sync_api import Browser, expect

BOX = {"obstacle:x_m": "-30", "obstacle:y_m": "5", "obstacle:half_length_x_m": "3", "obstacle:height_m": "12"}

chrome = pytest.fixture(scope="module")(chromes)

TARGET = (-26.0, (60, -40))
"""Where the target is from its word, and how far it is drawn: to the right and up. In CSS pixels."""

MIDDLES = """(all) => all.map((each) => each.getBoundingClientRect())
  .filter((box) => box.x > 0)
  .map((box) => [box.x + box.width / 2, box.y + box.height / 2])"""
"""Of those that are in the picture."""

LOOK_MS = 500
"""Between two looks at a word; as long as it moves the camera does."""


def start(desk: Console) -> None:
    """By keys alone: to the button, into the sheet, off."""
    expect(desk.part("start")).not_to_have_attribute("aria-disabled", "true", timeout=FLIGHT_MS)
    desk.part("start").focus()
    desk.opens("Enter", "start-go")
    expect(desk.part("start-go")).to_be_focused()
    expect(desk.part("start-preflight")).to_have_class(re.compile("good"), timeout=SOON_MS)
    desk.page.keyboard.press("Enter")
    desk.says("show-phase", "running", FLIGHT_MS)


def resting(desk: Console, word: str) -> tuple[float, float]:
    """Where a word of the scene is, once the camera has come to rest. In CSS pixels."""
    words = desk.page.locator(".scene-word.thing").filter(has_text=word)
    seen: list[list[list[float]]] = []
    for _ in range(60):
        seen = [*seen[-2:], words.evaluate_all(MIDDLES)]
        if len(seen) == 3 and seen[0] == seen[1] == seen[2] and len(seen[0]) == 1:
            ((x, y),) = seen[0]
            return x, y
        desk.page.wait_for_timeout(LOOK_MS)
    raise AssertionError(f"{word!r} does not come to rest: {seen}")


def drag(desk: Console, word: str, off_px: float, by_px: tuple[int, int]) -> None:
    """What is drawn beside a word in the scene, by hand, until the page asks whether it shall be so."""
    x, y = resting(desk, word)
    y += off_px
    mouse = desk.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + by_px[0] / 2, y + by_px[1] / 2, steps=4)
    mouse.move(x + by_px[0], y + by_px[1], steps=4)
    mouse.up()
    expect(desk.part("ghost")).to_be_visible()


def move_target(desk: Console, ground: Station) -> None:
    """Seen from above, to the right and up: nothing is ordered before it is confirmed."""
    desk.press("camera-top")
    before = ground.client.target()
    drag(desk, "target", *TARGET)
    desk.page.keyboard.press("Escape")
    expect(desk.part("ghost")).to_be_hidden()
    assert (ground.client.target().x_m, ground.client.target().y_m) == (before.x_m, before.y_m)
    drag(desk, "target", *TARGET)
    desk.press("ghost-confirm")
    wait_until("moved", SOON_S, lambda: ground.client.target().x_m != before.x_m)
    after = ground.client.target()
    assert after.x_m is not None
    assert after.y_m is not None
    assert before.x_m is not None
    assert before.y_m is not None
    assert after.x_m > before.x_m + 1.0  # up is north, where the show's x axis points
    assert after.y_m > before.y_m + 1.0


def add_obstacle(desk: Console, ground: Station) -> None:
    desk.press("tab-obstacles")
    desk.press("obstacle-add")
    desk.part("obstacle-id").fill("tower")
    for field, value in BOX.items():
        desk.part(field).fill(value)
    desk.press("obstacle-save")
    wait_until("added", SOON_S, lambda: [each.id for each in ground.client.obstacles()] == ["tower"])
    (tower,) = ground.client.obstacles()
    assert (tower.x_m, tower.y_m, tower.half_length_x_m, tower.height_m) == (-30.0, 5.0, 3.0, 12.0)
    expect(desk.part("obstacle-tower")).to_be_visible()


def test_a_show_is_flown_by_the_page_alone(chrome: Browser, tmp_path: Path) -> None:
    with station(tmp_path, 5, radius_m=7.0, height_m=13.0) as ground, console(chrome, ground.url) as desk:
        desk.says("connection", "Live")
        start(desk)
        expect(desk.part("row-d1")).to_contain_text("formation")
        add_obstacle(desk, ground)
        move_target(desk, ground)
        assert desk.serious() == []

        desk.press("pause")
        desk.says("show-phase", "paused")
        desk.page.keyboard.press("Shift+R")
        desk.says("show-phase", "running")

        desk.press("stop")
        desk.says("show-phase", "coming home")
        desk.says("show-phase", "landed", FLIGHT_MS)
        expect(desk.part("airborne")).to_contain_text("0/5")
        assert [order.action for order in ground.client.orders()] == [*("stop", "resume", "pause", "start")]
        assert desk.wrong == []
