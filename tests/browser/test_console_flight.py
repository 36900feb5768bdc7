"""A crew flies a show by the page alone, by hand and by keys; what it does is seen in the service."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from console_bench import (
    BOX_PX,
    FLIGHT_MS,
    SOON_MS,
    SPHERE_PX,
    TARGET_PX,
    Console,
    Station,
    chromes,
    console,
    station,
)
from ground import SOON_S, wait_until
from playwright.sync_api import Browser, expect

BOX = {"obstacle:x_m": "4", "obstacle:y_m": "24", "obstacle:half_length_x_m": "2", "obstacle:height_m": "12"}

chrome = pytest.fixture(scope="module")(chromes)


def start(desk: Console) -> None:
    """By keys alone: to the button, into the sheet, off."""
    expect(desk.part("start")).not_to_have_attribute("aria-disabled", "true", timeout=FLIGHT_MS)
    desk.part("start").focus()
    desk.opens("Enter", "start-go")
    expect(desk.part("start-go")).to_be_focused()
    expect(desk.part("start-preflight")).to_have_class(re.compile("good"), timeout=SOON_MS)
    desk.closes("Enter", "sheet-start")
    desk.says("show-phase", "running", FLIGHT_MS)


def drag(desk: Console, x: float, y: float, by_px: tuple[int, int]) -> list[float]:
    """What is there in the scene, by hand, until the page asks whether it shall be so.

    Returns: the numbers of what it asks.
    """
    mouse = desk.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + by_px[0] / 2, y + by_px[1] / 2, steps=4)
    mouse.move(x + by_px[0], y + by_px[1], steps=4)
    mouse.up()
    expect(desk.part("ghost")).to_be_visible()
    return [float(each) for each in re.findall(r"-?\d+\.\d+", desk.part("ghost-text").inner_text())]


def moved(
    desk: Console, word: str, off_px: float, by_px: tuple[int, int], now: Callable[[], list[float]]
) -> list[float]:
    """What is drawn beside a word: dropped with Escape it is as it was, with Enter the service says the same.

    Returns: by how much each number has changed.
    """
    before = now()
    x, y = desk.resting(word)
    y += off_px
    drag(desk, x, y, by_px)
    desk.closes("Escape", "ghost")
    assert now() == before
    desired = drag(desk, x, y, by_px)
    assert now() == before
    desk.closes("Enter", "ghost")
    wait_until(f"{word} moved", SOON_S, lambda: now() == pytest.approx(desired))
    return [after - each for after, each in zip(desired, before, strict=True)]


def by_hand(desk: Console, ground: Station) -> None:
    """Seen from above, where up is north, and so the show's x axis."""

    def radius_m() -> list[float]:
        return [ground.client.formation().radius_m]

    def target_m() -> list[float]:
        target = ground.client.target()
        assert target.x_m is not None
        assert target.y_m is not None
        return [target.x_m, target.y_m]

    def tower_m() -> list[float]:
        (tower,) = ground.client.obstacles()
        return [tower.x_m, tower.y_m]

    for panel in "45":
        desk.page.keyboard.press(panel)  # closes it: what it covers cannot be taken hold of
    desk.press("camera-top")
    desk.page.mouse.move(640, 300)
    desk.page.mouse.wheel(0, 400)  # away, until the tower is in the picture
    (wider_m,) = moved(desk, "radius", SPHERE_PX, (24, 0), radius_m)
    assert wider_m > 0.5
    north_m, east_m = moved(desk, "tower", BOX_PX, (-30, 40), tower_m)
    assert (north_m < -0.5, east_m < -0.5) == (True, True)
    north_m, east_m = moved(desk, "target", TARGET_PX, (-60, -40), target_m)
    assert (north_m > 0.5, east_m < -0.5) == (True, True)


def add_obstacle(desk: Console, ground: Station) -> None:
    desk.press("tab-obstacles")
    desk.opens(lambda: desk.press("obstacle-add"), "obstacle-id")
    desk.part("obstacle-id").fill("tower")
    for field, value in BOX.items():
        desk.part(field).fill(value)
    desk.opens(lambda: desk.press("obstacle-save"), "obstacle-tower")
    wait_until("added", SOON_S, lambda: [each.id for each in ground.client.obstacles()] == ["tower"])
    (tower,) = ground.client.obstacles()
    assert (tower.x_m, tower.y_m, tower.half_length_x_m, tower.height_m) == (4.0, 24.0, 2.0, 12.0)


def test_a_show_is_flown_by_the_page_alone(chrome: Browser, tmp_path: Path) -> None:
    with (
        station(tmp_path, 4, takeoff_m=3.0, radius_m=4.0, height_m=9.0) as ground,
        console(chrome, ground.url) as desk,
    ):
        desk.says("connection", "Live")
        start(desk)
        expect(desk.part("row-d1")).to_contain_text("formation")
        add_obstacle(desk, ground)
        assert desk.serious() == []

        desk.phase("Shift+P", "paused")  # everything stands, and can be taken hold of
        by_hand(desk, ground)
        desk.phase("Shift+R", re.compile("assembling|running"))
        desk.phase("Shift+H", re.compile("returning home|landed"))
        desk.says("show-phase", "landed", FLIGHT_MS)
        expect(desk.part("airborne")).to_contain_text("0/4")
        assert [command.action for command in ground.client.commands()] == [
            *("stop", "resume", "pause", "start")
        ]
        assert desk.wrong == []
