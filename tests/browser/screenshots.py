"""Pictures of the console, taken of a real flight over the fake fleet: `make screenshots`.

Look at them. What is to be seen in docs/screenshots/ is what an operator sees.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[1]))

from console_bench import FLIGHT_MS, ROOT, Console, browser, console, fault
from ground import ORIGIN, SOON_S, flying_config, proper, service, wait_until
from machine import free_ports
from PIL import Image
from playwright.sync_api import expect
from replays import replay

from gcs import config as configuration
from gcs.client import Client

COUNT: Final = 16
SIZES: Final = ((1440, 900), (1024, 768), (390, 844))
FOLDER: Final = ROOT / "docs" / "screenshots"
SETTLED_S: Final = 3.0
"""For trails to grow, and the camera to come to rest."""


@contextmanager
def fleet(config: configuration.Config, port: int, control: int) -> Iterator[None]:
    """One process of fake vehicles, which hears faults."""
    command = [sys.executable, "-m", "gcs.sim", "--count", str(COUNT), "--port-base", str(port)]
    command += ["--origin", ORIGIN, "--grid-columns", "4", "--quirk", "late-ready=off"]
    command += ["--control", str(control), *proper(config)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.terminate()


def shoot(desk: Console, name: str, *panels: str | None) -> None:
    """In all sizes, with these panels open, left and right; where there is room for one, the left one."""
    for width, height in SIZES:
        desk.page.set_viewport_size({"width": width, "height": height})
        for side, panel in zip(("right", "left"), reversed(panels), strict=True):
            _open(desk, side, panel)
        time.sleep(SETTLED_S)
        picture = Image.open(BytesIO(desk.page.screenshot()))
        picture.convert("RGB").quantize(256).save(FOLDER / f"{name}-{width}x{height}.png", optimize=True)
        if desk.wrong:
            raise RuntimeError(f"{name} {width}x{height}: {desk.wrong}")


def _open(desk: Console, side: str, panel: str | None) -> None:
    is_open = desk.part(f"close-{side}").count() > 0
    if panel is None:
        if is_open:
            desk.press(f"close-{side}")
    elif desk.part(f"panel-{panel}").count() == 0:
        desk.press(f"tab-{panel}")


def fly(desk: Console, client: Client, control: int) -> None:
    """Preflight that fails, then a flight, from the ground back to it."""
    wait_until("ready", SOON_S, lambda: all(each.ready for each in client.fleet().vehicles))
    fault(control, vehicle=3, fault="fix", type="2d")
    fault(control, vehicle=7, fault="battery", remaining=0.18)
    wait_until("fails", SOON_S, lambda: not client.preflight.report().passes)
    shoot(desk, "preflight", "preflight", "fleet")
    fault(control, vehicle=3, fault="fix", type="3d")
    fault(control, vehicle=7, fault="battery", remaining=0.93)
    wait_until("passes", SOON_S, lambda: client.preflight.report().passes)
    client.add_obstacle(
        x_m=45.0, y_m=10.0, half_length_x_m=4.0, half_length_y_m=3.0, height_m=30.0, obstacle_id="tower"
    )
    client.start()
    desk.says("show-phase", "running", FLIGHT_MS)
    client.change_orbit(radius_m=14.0, speed_m_s=2.0)
    time.sleep(4 * SETTLED_S)
    shoot(desk, "scene", None, None)
    shoot(desk, "desk", "shape", "plots")
    client.stop()
    desk.says("show-phase", "landed", FLIGHT_MS)


def main() -> None:
    """Overwrites what is in docs/screenshots."""
    FOLDER.mkdir(exist_ok=True)
    port, control = free_ports(COUNT), free_ports()
    raw = flying_config(COUNT, port, silence_s=5.0).model_dump()
    raw["api"]["port"] = free_ports()
    raw["formation"] |= {"radius_m": 10.0, "height_m": 18.0}
    raw["reactions"]["service_late"]["action"] = "ignore"  # a Chromium without a graphics card is beside it
    config = configuration.Config.model_validate(raw)
    url = f"http://127.0.0.1:{config.api.port}"
    with tempfile.TemporaryDirectory() as temporary, browser() as chrome:
        folder = Path(temporary) / "service"
        with (
            fleet(config, port, control),
            service(config, folder) as (client, _),
            console(chrome, url) as desk,
        ):
            fly(desk, client, control)
        with (
            replay(folder.name, "--speed", "4", folder=folder.parent) as url,
            Client(url, timeout_s=30.0) as client,
            console(chrome, url) as desk,
        ):
            wait_until("flies", SOON_S, lambda: client.show().phase == "running")
            client.playback.change(paused=True)
            _open(desk, "right", "certificate")
            desk.press("certificate-read")
            expect(desk.part("certificate-verdict")).to_be_visible(timeout=FLIGHT_MS)
            shoot(desk, "replay", None, "certificate")


if __name__ == "__main__":
    main()
