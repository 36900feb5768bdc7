"""An obstacle is placed by a click, drawn by a drag, sized by its handles, and saved by a key."""

import pytest
from playwright.sync_api import Browser, expect

from tests.support.api_background import Ticking, in_background
from tests.support.api_fake_service import FakeService
from tests.support.console_bench import Console, console
from tests.support.processes import SOON_S, wait_until

pytestmark = pytest.mark.soak

HANDLES = """(words) => words.map((word) => [word.textContent, word.getBoundingClientRect()])
  .filter(([, box]) => box.x > 0).map(([text, box]) => [text, box.x - 16, box.y + box.height / 2])"""


def field(ui: Console, name: str) -> float:
    return float(ui.part(f"obstacle:{name}").input_value())


def pulled(ui: Console, x: float, y: float, by_px: tuple[int, int]) -> None:
    """A press, and what follows it."""
    mouse = ui.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + by_px[0], y + by_px[1], steps=4)
    mouse.up()


def on_the_ground(ui: Console, by_px: tuple[int, int]) -> None:
    scene = ui.page.locator("#view").bounding_box()
    assert scene is not None
    pulled(ui, scene["x"] + 0.4 * scene["width"], scene["y"] + 0.6 * scene["height"], by_px)


def test_an_obstacle_is_placed_drawn_sized_and_saved(chrome: Browser) -> None:
    service = FakeService(4)
    with (
        in_background(Ticking(service)) as port,
        console(chrome, f"http://127.0.0.1:{port}", width=1440, height=900) as ui,
    ):
        ui.says("connection", "Live")
        ui.press("tab-obstacles")

        def changes(name: str, by_px: tuple[int, int]) -> None:
            """In a new form, until that field has another value."""
            ui.opens(lambda: ui.press("obstacle-add"), "obstacle-id")
            before = ui.part(f"obstacle:{name}").input_value()
            ui.until(
                lambda: on_the_ground(ui, by_px),
                lambda ms: expect(ui.part(f"obstacle:{name}")).not_to_have_value(before, timeout=ms),
            )

        changes("x_m", (0, 0))
        assert (field(ui, "half_length_x_m"), field(ui, "height_m")) == (2.0, 10.0)
        ui.closes("Escape", "obstacle-id")
        changes("half_length_y_m", (80, 40))

        before_m = field(ui, "height_m")

        def raise_top() -> None:
            words = ui.page.locator(".scene-word.handle-preview").evaluate_all(HANDLES)
            ((_, x, y),) = [each for each in words if "high" in each[0]]
            pulled(ui, x, y, (0, -60))

        def is_higher(within_ms: float) -> None:
            ui.page.wait_for_timeout(min(within_ms, 500.0))
            assert field(ui, "height_m") > before_m + 1.0

        ui.until(raise_top, is_higher)
        high_m, wide_m = field(ui, "height_m"), field(ui, "half_length_y_m")
        ui.press("close-left")  # what is not sent yet stays, and is offered below the scene
        ui.says("preview-text", f"{high_m:.1f} m high")
        ui.closes("Enter", "preview")
        wait_until("saved", SOON_S, lambda: len(service.plan.current.obstacles) == 1)
        (box,) = service.plan.current.obstacles
        assert (box.height_m, box.half_length_y_m) == (high_m, wide_m)
        assert ui.wrong == []
