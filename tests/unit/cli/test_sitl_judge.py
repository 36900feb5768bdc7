"""The judge of `make sitl` tells an autopilot's height error from an error of the shape."""

import numpy as np
import pytest

from gcs.cli.demo.demo_report import GroundTruth
from tests.sitl.sitl_flight import Account, Window
from tests.sitl.sitl_judge import by_autopilot, reported_off_m

IDS = ["d1", "d2", "d3", "d4"]
WINDOW = Window(10.0, 12.0, frozenset(IDS))
HEIGHT_M = 25.0
OFF_M = np.array([(0.4, 0.0, -1.0), (0.0, 0.3, 0.0), (-0.2, 0.0, -1.2), (0.0, -0.3, -0.2)])
MIXED = ["ardupilot", "px4", "ardupilot", "px4"]


def flown() -> tuple[Account, GroundTruth]:
    """Each reports a place beside its own, in the window; before it another one."""
    account = Account()
    position_m = np.broadcast_to((0.0, 0.0, -HEIGHT_M), (3, 4, 3))
    for time_s in (9.0, 10.0, 11.0, 12.0):
        account.rows.append((time_s, 0.0, 0.0, -HEIGHT_M, 10.0, 0.0, 0.0))
        off_m = OFF_M if time_s >= WINDOW.start_s else 9.0 * OFF_M
        places = (position_m[0] + off_m).tolist()
        account.reported.append({vehicle: tuple(place) for vehicle, place in zip(IDS, places, strict=True)})
    airborne = np.ones((3, 4), dtype=bool)
    return account, GroundTruth(np.array([10.0, 11.0, 12.0]), position_m, airborne, ~airborne[-1])


def test_what_a_vehicle_errs_is_that_of_the_window() -> None:
    account, truth = flown()
    assert reported_off_m(account, WINDOW, truth, IDS) == pytest.approx(OFF_M)


def test_a_vehicle_that_reported_nothing_has_its_kinds_height() -> None:
    account, truth = flown()
    for known in account.reported:
        del known["d1"]
    off_m = reported_off_m(account, WINDOW, truth, IDS)
    assert np.isnan(off_m[0]).all()
    assert by_autopilot(-off_m[:, 2], MIXED) == pytest.approx([1.2, 0.1, 1.2, 0.1])


def test_each_autopilot_has_the_mean_error_of_its_vehicles() -> None:
    assert by_autopilot(-OFF_M[:, 2], MIXED) == pytest.approx([1.1, 0.1, 1.1, 0.1])


def test_what_one_autopilot_has_in_common_is_the_centres_error() -> None:
    assert not by_autopilot(-OFF_M[:, 2], ["ardupilot"] * 4).any()
