"""Pictures of the console, taken of a real flight over the fake fleet: `make screenshots`.

Look at them. What is to be seen in docs/screenshots/ is what an operator sees. `--every-size --folder FOLDER`
takes each picture in every size that the console is made for, and leaves docs/screenshots as it is.
"""

import argparse
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Final

from PIL import Image
from playwright.sync_api import Browser, Page, expect

from gcs.client import Client
from gcs.config import schema as configuration
from tests.support.console_bench import FLIGHT_MS, ROOT, SOON_MS, Console, browser, console, fault, station
from tests.support.machine import free_ports
from tests.support.processes import (
    ORIGIN,
    SOON_S,
    flying_config,
    proper,
    service,
    session_of,
    wait_passes,
    wait_until,
)
from tests.support.replays import replay
from tests.support.started import DEVNULL, Started

Size = tuple[int, int]
"""Width and height of the window, CSS pixels."""

COUNT: Final = 16
DRAWING: Final = ROOT / "configs" / "shows" / "drawn-30.skyc"
DESKS: Final[tuple[Size, ...]] = ((1440, 900), (1024, 768))
PHONES: Final[tuple[Size, ...]] = ((390, 844), (844, 390))
EVERY: Final[tuple[Size, ...]] = (
    *((360, 640), (640, 360), (390, 844), (844, 390), (768, 1024), (1024, 768)),
    *((1440, 900), (900, 1440), (2560, 1440), (1440, 2560)),
)
PADS: Final = ("--grid-columns", "4", "--grid-at=-2.5,-7.5")
"""In the middle of the meadow."""
SETTLED_S: Final = 2.0
"""For trails to grow, and the camera to come to rest."""
LAID_OUT_MS: Final = 500
"""For the page to take note of the window's new size."""
FOLLOWED_S: Final = 25.0
"""For the formation to be over the target that it follows."""
STALL_S: Final = 8.0
"""Longer than the fake vehicles fly on without setpoints."""


@contextmanager
def fleet(config: configuration.Config, port: int, control: int) -> Iterator[None]:
    """One process of fake vehicles, which receives faults."""
    command = [sys.executable, "-m", "gcs.sim", "--count", str(COUNT), "--port-base", str(port)]
    command += ["--origin", ORIGIN, "--grid-columns", "4", "--quirk", "late-ready=off"]
    command += ["--control", str(control), *proper(config)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.terminate()


@dataclass(frozen=True, slots=True)
class Photographer:
    """Where the pictures go, and in which sizes they are taken."""

    folder: Path
    every: bool  # in every size, not only in those that are asked for

    def shoot(
        self, ui: Console, name: str, *panels: str | None, sizes: tuple[Size, ...] = (*DESKS, *PHONES)
    ) -> None:
        """With these panels open, left and right; where one has room, the left one; on a phone none."""
        for width, height in EVERY if self.every else sizes:
            ui.page.set_viewport_size({"width": width, "height": height})
            ui.page.wait_for_timeout(LAID_OUT_MS)
            is_small = ui.part("panels").get_attribute("data-layout") in {"sheet", "side"}
            for side, panel in zip(("right", "left"), reversed(panels), strict=True):
                _open(ui, side, None if is_small else panel)
            self.take(ui.page, f"{name}-{width}x{height}")
            if ui.wrong:
                raise RuntimeError(f"{name} {width}x{height}: {ui.wrong}")

    def take(self, page: Page, name: str) -> None:
        """As it looks once it has come to rest; 256 colours are enough."""
        time.sleep(SETTLED_S)
        picture = Image.open(BytesIO(page.screenshot()))
        picture.convert("RGB").quantize(256).save(self.folder / f"{name}.png", optimize=True)


def _open(ui: Console, side: str, panel: str | None) -> None:
    is_open = ui.part(f"close-{side}").count() > 0
    if panel is None:
        if is_open:
            ui.press(f"close-{side}")
    elif ui.part(f"panel-{panel}").count() == 0:
        ui.press(f"tab-{panel}")


def stall(ui: Console, process: Started) -> None:
    """The service stands still for longer than the vehicles wait for its setpoints."""
    process.send_signal(signal.SIGSTOP)
    time.sleep(STALL_S)
    process.send_signal(signal.SIGCONT)
    expect(ui.part("take-over")).to_be_visible(timeout=SOON_MS)
    ui.says("connection", "Live")


def preview(camera: Photographer, ui: Console) -> None:
    """A drawing is uploaded, its show looked at before it flies, and its pads fitted to the vehicles."""
    _open(ui, "left", "shows")
    ui.part("show-upload").set_input_files(DRAWING)
    expect(ui.part("drawn")).to_be_visible(timeout=SOON_MS)
    ui.part("drawn-scrubber").fill("30")
    camera.shoot(ui, "drawn", "shows", None, sizes=((1440, 900), (390, 844)))
    ui.page.set_viewport_size({"width": 1440, "height": 900})
    _open(ui, "left", "shows")
    ui.opens(lambda: ui.press("show-place-drawn-30"), "placing")
    ui.press("placing-fit")
    expect(ui.part("placing-summary")).to_contain_text("off the pads", timeout=SOON_MS)
    camera.shoot(ui, "placing", "shows", None, sizes=((1440, 900), (844, 390), (390, 844)))
    ui.closes(lambda: ui.press("placing-close"), "placing")
    ui.closes(lambda: ui.press("drawn-close"), "drawn")


def fly(camera: Photographer, ui: Console, client: Client, control: int) -> None:
    """Preflight that fails, then a flight."""
    wait_until("ready", SOON_S, lambda: all(each.ready for each in client.fleet().vehicles))
    if camera.every:
        camera.shoot(ui, "idle", "shape", "fleet")
    fault(control, vehicle=3, fault="fix", type="2d")
    fault(control, vehicle=7, fault="battery", remaining=0.18)
    wait_until("fails", SOON_S, lambda: not client.preflight.report().passes)
    camera.shoot(ui, "preflight", "preflight", "fleet", sizes=DESKS)
    fault(control, vehicle=3, fault="fix", type="3d")
    fault(control, vehicle=7, fault="battery", remaining=0.93)
    wait_passes(client)
    client.add_obstacle(
        x_m=45.0, y_m=10.0, half_length_x_m=4.0, half_length_y_m=3.0, height_m=30.0, obstacle_id="tower"
    )
    client.start()
    ui.says("show-phase", "running", FLIGHT_MS)
    client.change_orbit(radius_m=14.0, speed_m_s=2.0)
    time.sleep(4 * SETTLED_S)
    camera.shoot(ui, "scene", None, None)
    camera.shoot(ui, "panels", "shape", "plots", sizes=DESKS)


def go_wrong(camera: Photographer, ui: Console, client: Client, control: int, process: Started) -> None:
    """Three alarms, a kill that is not confirmed, a stall, and home."""
    fault(control, vehicle=3, fault="silence")
    fault(control, vehicle=7, fault="battery", remaining=0.18)
    fault(control, vehicle=11, fault="pilot", mode="POSITION")
    wait_until("three alarms", SOON_S, lambda: len(client.fleet().alarms) >= 3)
    ui.page.set_viewport_size({"width": 1440, "height": 900})
    _open(ui, "right", "fleet")
    for name in ("d1", "d2", "d5"):
        ui.part(f"row-{name}").click(modifiers=["Control"])
    camera.shoot(ui, "alarms", None, "fleet")
    ui.opens("Shift+K", "kill-arm")
    camera.shoot(ui, "kill", None, "fleet", sizes=PHONES)
    ui.press("kill-arm")
    expect(ui.part("kill-hold")).to_be_visible(timeout=SOON_MS)
    for width, height in PHONES:  # before the code expires
        ui.page.set_viewport_size({"width": width, "height": height})
        camera.take(ui.page, f"armed-{width}x{height}")
    ui.press("kill-disarm")
    ui.closes("Escape", "sheet-kill")

    stall(ui, process)
    camera.shoot(ui, "recovery", None, "fleet")
    if camera.every:
        ui.page.set_viewport_size({"width": 390, "height": 844})
        ui.part("start").click(force=True)  # not available: the page says why
        camera.take(ui.page, "unavailable-390x844")
        ui.press("tab-fleet")
        camera.take(ui.page, "recovery-fleet-390x844")
        ui.page.set_viewport_size({"width": 844, "height": 390})
        camera.take(ui.page, "recovery-fleet-844x390")
    ui.press("bring-home")
    for vehicle in (3, 11):
        fault(control, vehicle=vehicle, fault="none")
    wait_until("received", SOON_S, lambda: client.vehicle("d3").phase != "lost")
    client.command_vehicles("take-control", ["d11"])
    wait_until("under control", SOON_S, lambda: client.vehicle("d11").phase == "hold")
    ui.press("stop")
    wait_until("landed", SOON_S, lambda: client.fleet().counts.airborne == 0)


def watch(camera: Photographer, ui: Console, client: Client) -> None:
    """The flight once more, with what its scrubber marks."""
    wait_until("flies", SOON_S, lambda: client.show().phase == "running")
    client.playback.change(paused=True)
    ui.page.set_viewport_size({"width": 1440, "height": 900})
    _open(ui, "right", "report")
    ui.press("report-read")
    expect(ui.part("report-verdict")).to_be_visible(timeout=FLIGHT_MS)
    camera.shoot(ui, "replay", None, "report", sizes=(*DESKS, (844, 390)))


def follow(camera: Photographer, chrome: Browser, folder: Path) -> None:
    """A flight over a boat that reports itself."""
    folder.mkdir()
    at = f"udp://127.0.0.1:{free_ports()}"
    targets = [{"name": "boat", "sources": [{"kind": "nmea", "at": at}], "delay_s": 0.3}]
    motion = ("--target", "boat", "--send", "nmea", "--to", at, "--delay", "0.3", "--noise", "1")
    with (
        station(folder, 8, sections={"targets": targets}, radius_m=7.0, height_m=14.0) as ground,
        console(chrome, ground.url, width=1440, height=900) as ui,
    ):
        client = ground.client
        wait_until("ready", SOON_S, lambda: all(each.ready for each in client.fleet().vehicles))
        wait_passes(client)
        client.start()
        ui.says("show-phase", "running", FLIGHT_MS)
        boat = Started("gcs.sim", *motion, "--origin", ORIGIN, "--grid-at=-15,25", stdout=DEVNULL)
        try:
            wait_until("tracked", SOON_S, lambda: client.targets().targets[0].state == "tracked")
            client.select_target("boat")
            time.sleep(FOLLOWED_S)
            camera.shoot(ui, "targets", None, "feature-targets", sizes=((1440, 900),))
        finally:
            boat.terminate()
            boat.wait()


def draw_site(camera: Photographer, chrome: Browser, folder: Path) -> None:
    """A site that is edited, before its vehicles fly."""
    (folder / "sites").mkdir(parents=True)
    shutil.copy(ROOT / "configs" / "sites" / "lakeside.geojson", folder / "sites")
    with (
        session_of("lakeside", folder, "--count", "8", "--spacing", "5", *PADS, height_m=18.0) as (url, _),
        console(chrome, url, width=1440, height=900) as ui,
    ):
        ui.says("connection", "Live")
        _open(ui, "right", "feature-site")
        ui.opens(lambda: ui.press("site-edit"), "site-editor")
        camera.shoot(ui, "site", None, "feature-site", sizes=((1440, 900),))


def main() -> None:
    """Overwrites what is in the folder."""
    parser = argparse.ArgumentParser(description="Pictures of the console.")
    parser.add_argument("--folder", type=Path, default=ROOT / "docs" / "screenshots")
    parser.add_argument("--every-size", action="store_true", help="each picture in every size")
    options = parser.parse_args()
    camera = Photographer(options.folder, options.every_size)
    camera.folder.mkdir(exist_ok=True, parents=True)
    port, control = free_ports(COUNT), free_ports()
    raw = flying_config(COUNT, port, silence_s=5.0).model_dump()
    raw["api"]["port"] = free_ports()
    raw["formation"] |= {"radius_m": 10.0, "height_m": 18.0}
    raw["failsafes"]["service_late"]["action"] = "ignore"  # a Chromium without a graphics card is beside it
    raw["failsafes"]["links_late"] |= {"late_s": 5.0, "arrive_min": 0.2}  # and takes time from the vehicles
    with tempfile.TemporaryDirectory() as temporary, browser() as chrome:
        raw["shows"] = {"folder": Path(temporary) / "shows"}
        config = configuration.Config.model_validate(raw)
        url = f"http://127.0.0.1:{config.api.port}"
        folder = Path(temporary) / "service"
        with (
            fleet(config, port, control),
            service(config, folder) as (client, process),
            console(chrome, url) as ui,
        ):
            preview(camera, ui)
            fly(camera, ui, client, control)
            go_wrong(camera, ui, client, control, process)
            ui.page.goto(f"{url}/docs")
            ui.page.locator(".opblock").first.wait_for(timeout=SOON_MS)
            for width, height in ((1440, 900), (390, 844)) if camera.every else ((1440, 900),):
                ui.page.set_viewport_size({"width": width, "height": height})
                camera.take(ui.page, f"docs-{width}x{height}")
            process.send_signal(signal.SIGINT)  # as an operator ends it: its flight data end whole
            process.wait(SOON_S)
        with (
            replay(folder.name, "--speed", "4", folder=folder.parent) as url,
            Client(url, timeout_s=30.0) as client,
            console(chrome, url) as ui,
        ):
            watch(camera, ui, client)
        follow(camera, chrome, Path(temporary) / "target")
        draw_site(camera, chrome, Path(temporary) / "site")


if __name__ == "__main__":
    main()
