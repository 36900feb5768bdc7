"""`gcs demo --target`: a target that reports where it is, followed and judged by where it truly was."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from gcs.cli.demo.demo_report import GroundTruth
from gcs.cli.demo.demo_script import SETTLE_S, DemoScript, Scale
from gcs.client import Client
from gcs.config import schema as configuration
from gcs.links.features import TakSettings
from gcs.model.errors import CommandError, ConfigError, GcsError
from gcs.sim.settings import PAD_SPACING_M

NAME: Final = "target"
MOTION: Final = "boat"

SOURCES: Final[dict[str, dict[str, object]]] = {
    "nmea": {"kind": "nmea", "at": "udp://127.0.0.1:10110"},
    "gpsd": {"kind": "gpsd", "at": "tcp://127.0.0.1:2947"},
    "cot": {"kind": "cot", "at": "udp://127.0.0.1:6969", "track": NAME},
    "mavlink": {"kind": "mavlink", "at": "udp://127.0.0.1:14560", "system_id": 42},
}
"""What a demonstration follows, by the name of what is sent."""

DELAY_S: Final = 0.3
"""Of its reports. Where the clock is not synchronised, the service takes it from its configuration."""

FOUND_S, JOINED_S, FOLLOWED_S = 30.0, 20.0, 30.0
"""Until the target is tracked; until the formation is over it; least time for which it is followed."""

ENDS_S: Final = 0.5
"""So much earlier what is judged ends: on the way home there is no centre."""

P95_MAX_M: Final = 2.0
"""Of the distance from the true target, with which a demonstration counts as passed."""


def fit(raw: dict[str, Any], kind: str | None, tak: str | None) -> None:
    """Have a configuration follow a target, which goes farther than the story does, and send to TAK.

    Raises: ConfigError for an address of TAK that is none.
    """
    if kind is not None:
        raw["targets"] = [{"name": NAME, "sources": [SOURCES[kind]], "delay_s": DELAY_S}]
        raw["control"]["safety"]["fence"]["distance_max_m"] = 1000.0
    if tak is not None:
        raw["tak"] = {"to": [tak], "callsign": "DEMO", "require_clock": False}
        try:
            TakSettings.model_validate(raw["tak"])
        except ValidationError:
            raise ConfigError(f"--tak {tak}: udp://, tcp:// or tls://HOST:PORT is needed") from None


@contextmanager
def fake_target(config: configuration.Config, kind: str, seed: int, truth: Path) -> Iterator[None]:
    """Run the target in a process of its own, which ends with the block; it begins beside the pads."""
    frame = config.show_frame
    command = [sys.executable, "-m", "gcs.sim", "--target", MOTION, "--send", kind]
    command += ["--origin", f"{frame.latitude_deg},{frame.longitude_deg},{frame.altitude_amsl_m}"]
    command += [f"--grid-at={-2.0 * PAD_SPACING_M:g},0", "--name", NAME, "--seed", str(seed)]
    command += ["--noise", "1", "--delay", f"{DELAY_S:g}", "--truth", str(truth)]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)  # noqa: S603
    try:
        yield
    finally:
        child.terminate()
        child.wait()


class TargetScript(DemoScript):
    """Follows the target until it is time to go home; every step is an API call."""

    def __init__(self, client: Client, seconds: float, say: Callable[[str], None], scale: Scale) -> None:
        super().__init__(client, seconds, say, scale)
        self.followed: tuple[float, float] | None = None

    def _fly_over(self) -> None:
        self._client.change_orbit(radius_m=0.0)
        self._client.select_target(NAME)
        self._until("the target", FOUND_S, self._is_tracked)
        self._say(f"the {MOTION} is selected; the formation flies over it")
        self._sleep(JOINED_S)
        begin_s = self._now_s()
        self._sleep(max(FOLLOWED_S, self._left_s() - self._scale.home_s - SETTLE_S))
        self._need_running()
        self.marks.before = self.followed = (begin_s, self._now_s() - ENDS_S)
        if not self._is_tracked():
            raise CommandError(f"the target did not last: {self._client.targets().targets[0].why}")
        self._client.hold_target()

    def _is_tracked(self) -> bool:
        return self._client.targets().targets[0].state == "tracked"


def figures(
    truth: GroundTruth, file: Path, config: configuration.Config, script: TargetScript
) -> dict[str, object]:
    """Distances of the true centroid from the true target while it was followed. Raises: GcsError."""
    if script.followed is None:
        return {}
    try:
        rows = [json.loads(line) for line in file.read_text().splitlines()]
        time_s = np.array([row["time_s"] for row in rows])
        ned_m = np.array([row["ned_m"] for row in rows])
    except (OSError, ValueError, KeyError) as error:
        raise GcsError(f"{file}: no true states of the target: {error}") from None
    place_m = config.frame.from_ned(ned_m)
    flown = truth.between(*script.followed)
    target_m = np.stack([np.interp(flown.time_s, time_s, place_m[:, axis]) for axis in range(2)], axis=1)
    off_m = np.linalg.norm(flown.position_m.mean(axis=1)[:, :2] - target_m, axis=1)
    median_m, p95_m = np.percentile(off_m, [50, 95]).tolist()
    return {
        "target_median_m": round(median_m, 2),
        "target_p95_m": round(p95_m, 2),
        "target_worst_m": round(float(off_m.max()), 2),
        "target_followed_s": round(script.followed[1] - script.followed[0], 1),
    }
