"""A crew flies a show by the page alone, by hand and by keys; what it does is seen in the service."""

import re
from collections.abc import Callable
from itertools import groupby
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.support.console_bench import (
    BOX_PX,
    FLIGHT_MS,
    LOOK_MS,
    SOON_MS,
    SPHERE_PX,
    TARGET_PX,
    Console,
    Station,
    console,
    fault,
    station,
)
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, wait_until

BOX = {"obstacle:x_m": "4", "obstacle:y_m": "24", "obstacle:half_length_x_m": "2", "obstacle:height_m": "12"}


def start(ui: Console) -> None:
    """By keys alone: to the button, into the sheet, off."""
    expect(ui.part("start")).not_to_have_attribute("aria-disabled", "true", timeout=FLIGHT_MS)
    ui.part("start").focus()
    ui.opens("Enter", "start-go")
    expect(ui.part("start-go")).to_be_focused()
    expect(ui.part("start-preflight")).to_have_class(re.compile("good"), timeout=SOON_MS)
    ui.closes("Enter", "sheet-start")
    ui.says("show-phase", "running", FLIGHT_MS)


def drag(
    ui: Console, word: str, off_px: float, by_px: tuple[int, int], meanwhile: Callable[[], None] | None = None
) -> list[float]:
    """Drag what is drawn `off_px` below a word of the scene, until the page asks for confirmation.

    An alarm that appears between the look and the press takes room from the scene: then it is dragged again.

    Args:
        meanwhile: called while the mouse button is down.

    Returns: the numbers that the page asks to confirm.
    """
    mouse = ui.page.mouse

    def pull() -> None:
        x, y = ui.resting(word)
        y += off_px
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + by_px[0] / 2, y + by_px[1] / 2, steps=4)
        if meanwhile is not None:
            meanwhile()
        mouse.move(x + by_px[0], y + by_px[1], steps=4)
        mouse.up()

    ui.opens(pull, "preview")
    return [float(each) for each in re.findall(r"-?\d+\.\d+", ui.part("preview-text").inner_text())]


def moved(
    ui: Console, word: str, off_px: float, by_px: tuple[int, int], now: Callable[[], list[float]]
) -> list[float]:
    """What is drawn beside a word: dropped with Escape it is as it was, with Enter the service says the same.

    Returns: by how much each number has changed.
    """
    before = now()
    drag(ui, word, off_px, by_px)
    ui.closes("Escape", "preview")
    assert now() == before
    desired = drag(ui, word, off_px, by_px)
    assert now() == before
    ui.closes("Enter", "preview")
    wait_until(f"{word} moved", SOON_S, lambda: now() == pytest.approx(desired))
    return [after - each for after, each in zip(desired, before, strict=True)]


def by_hand(ui: Console, ground: Station) -> None:
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
        sides_m = [2.0 * tower.half_length_x_m, 2.0 * tower.half_length_y_m]
        return [tower.x_m, tower.y_m, *sides_m, tower.height_m]

    for panel in "45":
        ui.page.keyboard.press(panel)  # closes it: what it covers cannot be taken hold of
    ui.press("camera-top")
    ui.page.mouse.move(640, 300)
    ui.page.mouse.wheel(0, 400)  # away, until the tower is in the picture
    (wider_m,) = moved(ui, "radius", SPHERE_PX, (24, 0), radius_m)
    assert wider_m > 0.5
    north_m, east_m, *sizes_m = moved(ui, "tower", BOX_PX, (-30, 40), tower_m)
    assert (north_m < -0.5, east_m < -0.5, sizes_m) == (True, True, [0.0, 0.0, 0.0])
    north_m, east_m = moved(ui, "target", TARGET_PX, (-60, -40), target_m)
    assert (north_m > 0.5, east_m < -0.5) == (True, True)


def an_alarm_leaves_the_scene_where_it_is(ui: Console, control: int) -> None:
    """The list of alarms takes room from the scene; while something is dragged it does not."""

    seen: list[list[list[float]]] = []

    def alarm() -> None:
        ui.page.wait_for_timeout(LOOK_MS)  # the first look is after the picture of the preview
        seen.append(ui.places("target"))
        fault(control, vehicle=4, fault="battery", remaining=0.12)
        expect(ui.page.locator("[data-alarm][data-cause=low-battery]").first).to_be_visible(timeout=SOON_MS)
        ui.page.wait_for_timeout(LOOK_MS)
        seen.append(ui.places("target"))

    drag(ui, "radius", SPHERE_PX, (24, 0), alarm)
    ui.closes("Escape", "preview")
    before, after = seen[-2:]
    assert before == after


def add_obstacle(ui: Console, ground: Station) -> None:
    ui.press("tab-obstacles")
    ui.opens(lambda: ui.press("obstacle-add"), "obstacle-id")
    ui.part("obstacle-id").fill("tower")
    for field, value in BOX.items():
        ui.part(field).fill(value)
    ui.opens(lambda: ui.press("obstacle-save"), "obstacle-tower")
    wait_until("added", SOON_S, lambda: [each.id for each in ground.client.obstacles()] == ["tower"])
    (tower,) = ground.client.obstacles()
    assert (tower.x_m, tower.y_m, tower.half_length_x_m, tower.height_m) == (4.0, 24.0, 2.0, 12.0)


def test_a_show_is_flown_by_the_page_alone(chrome: Browser, tmp_path: Path) -> None:
    control = free_ports()
    with (
        station(tmp_path, 4, takeoff_m=3.0, radius_m=5.0, height_m=10.0, control=control) as ground,
        console(chrome, ground.url) as ui,
    ):
        ui.says("connection", "Live")
        start(ui)
        expect(ui.part("row-d1")).to_contain_text("formation")
        add_obstacle(ui, ground)

        ui.phase("Shift+P", "paused")  # everything stands, and can be taken hold of
        by_hand(ui, ground)
        an_alarm_leaves_the_scene_where_it_is(ui, control)
        ui.phase("Shift+R", re.compile("assembling|running"))
        ui.phase("Shift+H", re.compile("returning home|landed"))
        ui.says("show-phase", "landed", FLIGHT_MS)
        expect(ui.part("airborne")).to_contain_text("0/4")
        commands = (command.action for command in ground.client.commands())
        assert [action for action, _ in groupby(commands)] == [  # `phase` may press a key twice
            *("stop", "resume", "return", "pause", "start")  # return: the failsafe of the low battery
        ]
        assert ui.wrong == []
