"""What a real ArduCopter does, unflattered: console text, slow clocks, heights, texts by release."""

from __future__ import annotations

import pytest

from gcs.sim.autopilots.ardupilot.modes import Mode
from gcs.sim.autopilots.ardupilot.texts import breach_text, refusal_text
from tests.support.ardu_bench import ArduBench, cruising, hovering
from tests.support.sim_bench import UNSUPPORTED

pytestmark = pytest.mark.soak


def test_console_text_comes_before_and_between_frames_at_boot() -> None:
    bench = ArduBench(late=True, asked=False)
    bench.run(0.1)
    assert (bench.console.startswith(b"\n\nInit ArduCopter V4.1.0-dev"), bench.received) == (True, [])
    bench.run(3.0)
    assert bench.console.endswith(b"Ready to FLY  ")
    assert bench.count("HEARTBEAT") >= 2
    written = len(bench.console)
    assert len(bench.run(5.0).console) == written
    bench.command(246, 1)
    assert bench.run(0.2).console.count(b"Init ArduCopter") == 2


def test_heights_are_reported_5_percent_too_large() -> None:
    """Flown with 4.0.7 and 4.5.5: 25.1 m reported, 23.9 m true."""
    bench = hovering(25.1, scaled=True)
    reported_m = bench.last("GLOBAL_POSITION_INT").relative_alt * 1e-3
    assert reported_m == pytest.approx(25.1, abs=0.3)
    assert bench.height_m == pytest.approx(reported_m / 1.05, abs=0.05)
    bench.stream(0.0, 0.0, 1.0)
    bench.run(4.0)
    assert bench.velocity[2] == pytest.approx(1.0 / 1.05, abs=0.03)
    assert bench.last("GLOBAL_POSITION_INT").vz == pytest.approx(100, abs=3)


def test_receiver_reports_the_true_height_beside_the_scaled_one() -> None:
    bench = hovering(25.1, scaled=True)
    bench.ask({24: 2.0, 33: 2.0})
    bench.run(2.0)
    reported_m = bench.last("GLOBAL_POSITION_INT").alt * 1e-3
    received_m = bench.last("GPS_RAW_INT").alt * 1e-3
    assert reported_m - received_m == pytest.approx(0.05 * bench.height_m, abs=0.1)


def test_clocks_are_the_simulators_and_may_be_slow() -> None:
    bench = ArduBench(clock_rate=0.984)
    bench.ask({2: 10.0})
    first = bench.run(1.0).last("SYSTEM_TIME")
    last = bench.run(20.0).last("SYSTEM_TIME")
    assert last.time_boot_ms - first.time_boot_ms == pytest.approx(0.984 * 20_000, abs=150)
    assert (last.time_unix_usec - first.time_unix_usec) * 1e-6 == pytest.approx(0.984 * 20, abs=0.15)


@pytest.mark.parametrize(
    ("release", "one", "two"),
    [
        ((4, 0), None, None),
        ((4, 1), "Fence Breached", "Fence Breached"),
        ((4, 5), "Fence Breached", "Fence Breached"),
        ((4, 6), "Circle fence breached", "Max Alt and Circle fences breached"),
        ((4, 7), "Circle fence breached", "Max Alt and Circle fences breached"),
    ],
)
def test_the_text_of_a_breach_by_release(release: tuple[int, int], one: str | None, two: str | None) -> None:
    assert (breach_text(release, 2), breach_text(release, 3)) == (one, two)


def test_the_text_of_a_refused_mode_by_release() -> None:
    texts = [refusal_text(release, "GUIDED", "requires position") for release in ((4, 0), (4, 1))]
    assert texts == [
        "Mode change failed: GUIDED requires position",
        "Mode change to GUIDED failed: requires position",
    ]


def test_texts_of_4_6_in_flight() -> None:
    fence = {"FENCE_ENABLE": 1, "FENCE_TYPE": 3, "FENCE_RADIUS": 30.0, "AVOID_ENABLE": 0}
    bench = cruising(5.0, version="4.6", parameters=fence)
    bench.until(lambda: "Circle fence breached" in bench.texts, 6.0)
    assert bench.order(Mode.AUTO) == [UNSUPPORTED]
    assert bench.texts[-1] == "Mode change to AUTO failed: init failed"
    bench.set_parameter("SIM_GPS_DISABLE", 1)
    bench.run(9.0)
    assert "GPS Glitch or Compass error" in bench.texts
    assert bench.texts[-2:] == ["EKF variance", "EKF Failsafe: changed to LAND Mode"]


@pytest.mark.parametrize(
    ("parameters", "acts"),
    [({}, False), ({"BATT_CRT_VOLT": 11.0}, True), ({"BATT_CRT_MAH": 500.0}, True)],
)
def test_a_critical_battery_acts_only_with_a_threshold(parameters: dict[str, float], acts: bool) -> None:
    settings = {"BATT_FS_CRT_ACT": 1, "BATT_LOW_VOLT": 0.0, "BATT_LOW_TIMER": 2, **parameters}
    bench = hovering(parameters=settings)
    bench.fleet.state.remaining[0] = 0.05
    bench.run(4.0)
    assert (bench.custom_mode == Mode.LAND) == acts
