"""Pads of 5 m suffice for what simulators report; a refusal says which pads or receivers would do."""

import re
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from gcs.config import schema as configuration
from gcs.config.schema import Config
from gcs.estimation.positioning import Positioning, uncertainty_m
from gcs.model.preflight_report import Check, State
from gcs.model.state import Array, FleetState, Telemetry
from gcs.planning.feasibility import smallest_formation_radius_m
from gcs.preflight.pad_distances import room_to_wander, spacing
from gcs.preflight.vehicles import PreflightInputs, own_checks
from gcs.sim.settings import PAD_SPACING_M
from tests.support.sim_bench import digest
from tests.support.tlog_files import frames
from tests.unit.preflight.test_preflight_checks import GOOD

SHIPPED = ("px4-sitl", "demo", "radio", "stations", "large")
Reported = tuple[float, float, float]
"""Fix type, accuracy sideways and up."""


@cache
def recorded(autopilot: str) -> Reported:
    """What the receiver of a recorded flight reported, last of all."""
    if autopilot == "px4":
        example = digest("session")["streams"]["GPS_RAW_INT"]["example"]
        return example["fix_type"], example["h_acc"] / 1e3, example["v_acc"] / 1e3
    parser = ardupilotmega.MAVLink(None)
    received = [parser.parse_char(bytes(frame.raw)) for _, frame in frames("ardupilot/session.tlog.xz")]
    gps = [message for message in received if message is not None and message.get_type() == "GPS_RAW_INT"]
    return gps[-1].fix_type, gps[-1].h_acc / 1e3, gps[-1].v_acc / 1e3


def _repeated(column: Any, count: int) -> Any:
    """The first row, so many times."""
    if isinstance(column, np.ndarray):
        return np.repeat(column[:1], count, axis=0)
    return (column[0],) * count


def standing(config: Config, reported: list[Reported], pads_m: Array) -> PreflightInputs:
    """Vehicles on these pads, with receivers that report so."""
    n, floor = len(reported), config.control.safety.floor
    fix, level_m, up_m = np.array(reported, dtype=np.float64).T.copy()
    ids, zero = tuple(f"d{row + 1}" for row in range(n)), np.zeros((n, 3))
    alike = {each.name: _repeated(getattr(GOOD, each.name), n) for each in fields(GOOD)}
    reported_by = {"ids": ids, "fix_type": fix, "horizontal_accuracy_m": level_m, "vertical_accuracy_m": up_m}
    telemetry = Telemetry(**{**alike, **reported_by})
    least = floor.uncertainty_m, floor.vertical_uncertainty
    given: dict[str, Any] = {
        "fleet": FleetState(0.0, ids, np.column_stack([pads_m, np.zeros(n)]), zero, np.zeros(n), np.zeros(n)),
        "rows": {name: row for row, name in enumerate(ids)},
        "telemetry": telemetry,
        "conflicts": {},
        "uncertainty_m": uncertainty_m(*least, level_m, up_m, fix, config.positioning),
        "age_max_s": 0.5,
        "floor": floor,
        "fence": config.control.safety.fence,
        "positioning": config.positioning,
        "settings": config.preflight,
    }
    return PreflightInputs(**given)


def grid_m(count: int, apart_m: float = PAD_SPACING_M) -> Array:
    """As `gcs sim` places them."""
    columns = int(np.ceil(np.sqrt(count)))
    return apart_m * np.array([divmod(row, columns) for row in range(count)], dtype=np.float64)


def refused(inputs: PreflightInputs) -> list[Check]:
    """All checks of receivers and pads that do not pass."""
    ids = inputs.fleet.ids
    near, room = spacing(inputs, ids), room_to_wander(inputs, ids, None)
    receivers = {"fix", "accuracy sideways", "accuracy up"}
    checks = [check for name in ids for check in (*near[name], *([room[name]] if name in room else []))]
    checks += [check for name in ids for check in own_checks(inputs, name) if check.name in receivers]
    return [check for check in checks if not check.passes]


def test_recordings_say_what_the_simulators_report() -> None:
    assert recorded("px4") == (3, 0.9, 1.78)
    assert recorded("ardupilot") == (6, 0.2, 0.2)


@pytest.mark.parametrize("autopilots", [("px4",), ("ardupilot",), ("px4", "ardupilot")])
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_configurations_accept_recorded_accuracies(name: str, autopilots: tuple[str, ...]) -> None:
    config = configuration.load(configuration.find(name))
    for count in {*range(2, 11), len(config.ids)}:
        reported = [recorded(autopilots[row % len(autopilots)]) for row in range(count)]
        inputs = standing(config, reported, grid_m(count))
        assert refused(inputs) == []
        least_m = smallest_formation_radius_m(count, config.control.safety, inputs.uncertainty_m)
        assert config.formation.radius_m >= least_m


def test_pads_that_measure_a_little_less_are_accepted() -> None:
    """Each reported place is off by 0.19 m (1 sigma), and SIH's pads by up to 0.2 m."""
    config = configuration.load(configuration.find("px4-sitl"))
    off_m = 2.0 * np.hypot(0.19, 0.19)
    assert refused(standing(config, [recorded("px4")] * 10, grid_m(10, PAD_SPACING_M - 0.2 - off_m))) == []


TWO_PADS_M = grid_m(2)
PLAIN = configuration.load(configuration.find("px4-sitl")).model_copy(update={"positioning": Positioning()})


def only(config: Config, reported: list[Reported], pads_m: Array = TWO_PADS_M) -> Check:
    (check,) = [
        one for one in refused(standing(config, reported, pads_m)) if one.name == "distance to the next"
    ]
    return check


def test_refusal_names_pads_and_receiver_that_would_do() -> None:
    check = only(PLAIN, [(3, 0.9, 1.78), (6, 0.02, 0.04)])
    assert check.state is State.FAIL
    assert check.problem == "stands 5.0 m from d2, at least 8.4 m is needed with a 3D fix of 0.9 m"
    assert check.to_do == "move d1 and d2 3.4 m farther apart, or use RTK (3.7 m)"


def test_rtk_that_reports_poor_accuracy_may_improve() -> None:
    check = only(PLAIN, [(6, 0.6, 0.5), (6, 0.02, 0.04)])
    assert check.problem.endswith("with an RTK fixed fix of 0.6 m")
    better = "or wait for a better accuracy (3.7 m at 0.05 m)"
    assert check.to_do == f"move d1 and d2 1.0 m farther apart, {better}"


def test_pads_too_close_for_any_receiver_are_to_be_moved() -> None:
    check = only(PLAIN, [(6, 0.02, 0.04)] * 2, grid_m(2, 2.0))
    assert check.to_do == "move d1 and d2 0.8 m farther apart"


@pytest.mark.parametrize(
    "reported", [(3, 0.9, 1.78), (4, 0.7, 1.0), (5, 0.3, 0.9), (6, 0.4, 0.1), (3, 1.9, 2.0)]
)
def test_advice_works_when_it_is_followed_literally(reported: Reported) -> None:
    apart_m = 2.5
    check = only(PLAIN, [reported] * 2, grid_m(2, apart_m))
    found = re.search(r"([\d.]+) m farther apart", check.to_do)
    assert found is not None
    moved_m = apart_m + float(found[1])
    assert refused(standing(PLAIN, [reported] * 2, grid_m(2, max(moved_m, 3.7)))) == []
    instead = re.search(r"\(([\d.]+) m", check.to_do)
    assert instead is not None
    assert refused(standing(PLAIN, [(6, 0.05, 0.1)] * 2, grid_m(2, float(instead[1])))) == []


def test_a_bad_receiver_on_the_ground_keeps_no_other_there() -> None:
    inputs = standing(PLAIN, [(2, 9.0, 9.0), (6, 0.02, 0.04)], grid_m(2))
    (alone,) = spacing(inputs, ["d2"])["d2"]
    assert alone.depends_on == ("d1", "d2")
    (beside,) = spacing(inputs, ["d2"], ["d2"])["d2"]
    assert (alone.state, beside.state) == (State.FAIL, State.PASS)


def test_a_vehicle_too_near_to_one_left_out_is_named_itself() -> None:
    inputs = standing(PLAIN, [(6, 0.02, 0.04)] * 2, grid_m(2, 1.0))
    found = spacing(inputs, ["d1", "d2"], ["d2"])
    assert [check.name for check in found["d2"] if not check.passes] == ["distance to the next"]
