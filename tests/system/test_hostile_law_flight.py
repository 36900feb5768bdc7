"""Twenty vehicles in real time, over each transport, with a law that does what none may.

Their receivers are ideal: with others a held vehicle makes room where one is not as high as reported.
"""

import shutil
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.demo.demo_report import GroundTruth, ground_truth, separation
from gcs.config.schema import Config
from gcs.formation.laws import registry
from tests.support import hostile_laws
from tests.support.machine import Pauses, free_ports
from tests.support.processes import (
    SOON_S,
    close_together,
    flying_config,
    proper,
    service,
    vehicles,
    wait_passes,
    wait_until,
)

pytestmark = pytest.mark.soak

COUNT, WELL_TICKS = 20, 200
HOLDS_WITHIN_S, STOPS_S, STANDS_M_S = 0.5, 1.5, 0.2
WINDOW_S = 0.5
"""Speeds are means over this time: true states come 50 times a second."""


def config_of(law: str, transport: str, base: int, mark: Path) -> tuple[Config, tuple[str, ...]]:
    """The configuration, and options of the vehicles."""
    raw = flying_config(COUNT, base, silence_s=20.0).model_dump(mode="json")
    raw["links"][0]["transport"] = transport
    raw["scheduling"] = "real-time"
    raw["control"]["law"]["laws"] = {law: {"well_ticks": WELL_TICKS, "marks": str(mark)}}
    config, square = close_together(Config.model_validate(raw))
    raw = config.model_dump(mode="json")
    raw["formation"]["law"] = law
    return Config.model_validate(raw), square


def speeds_m_s(truth: GroundTruth) -> np.ndarray:
    """(k, n) mean speeds over `WINDOW_S` from each time on."""
    step = round(WINDOW_S / float(np.diff(truth.time_s).mean()))
    moved_m = np.linalg.norm(truth.position_m[step:] - truth.position_m[:-step], axis=2)
    speed_m_s: np.ndarray = moved_m / (truth.time_s[step:] - truth.time_s[:-step])[:, None]
    return speed_m_s


@pytest.mark.parametrize("transport", ["native", "mavsdk"])
@pytest.mark.parametrize("kind", hostile_laws.IN_WHOLE_SHOWS)
def test_twenty_hold_and_come_home(
    kind: str, transport: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record, mark, law = tmp_path / "record", tmp_path / "mark", f"hostile_laws:{kind}"
    record.mkdir()
    shutil.copy(hostile_laws.__file__, record / "hostile_laws.py")
    monkeypatch.setattr(registry, "_beside", [])
    registry.allow_code(record)
    base = free_ports(COUNT)
    config, square = config_of(law, transport, base, mark)
    with (
        vehicles(COUNT, base, tmp_path, "--ideal", *square, *proper(config)),
        service(config, record, "--allow-law-code") as (client, _),
        Pauses() as machine,
    ):
        wait_passes(client)
        client.start()
        wait_until("paused", SOON_S, lambda: client.show().phase == "paused")
        assert mark.exists(), client.alarms()
        wait_until("alarm", SOON_S, lambda: any(one.cause == "law-failed" for one in client.alarms().alarms))
        (alarm,) = (one for one in client.alarms().alarms if one.cause == "law-failed")
        assert alarm.text.startswith(f"Law {law} failed: {hostile_laws.REASONS[kind]}")
        time.sleep(10.0)
        stops_s = time.monotonic()
        client.stop()
        wait_until("landed", SOON_S, lambda: client.show().phase == "landed")
    truth = ground_truth(tmp_path / "truth.jsonl", config.frame, COUNT)
    nearest_m, violations = separation(truth, config.control.safety.floor)
    hostile_s = float(mark.read_text())
    held = np.array(
        [
            machine.awake_s(hostile_s, time_s) > HOLDS_WITHIN_S + STOPS_S and time_s < stops_s - WINDOW_S
            for time_s in truth.time_s.tolist()
        ]
    )
    speed_m_s = speeds_m_s(truth)
    fastest_m_s = float(speed_m_s[held[: len(speed_m_s)]].max())
    words = f"{kind} over {transport}: nearest {nearest_m:.2f} m, fastest while held {fastest_m_s:.2f} m/s"
    sys.stdout.write(words + "\n")
    assert violations == 0
    assert fastest_m_s < STANDS_M_S
    assert truth.landed_at_end.all()
