"""What must hold of the autopilots' parameters, and what is said of those that do not."""

from math import inf, nan

import numpy as np
import pytest

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.links import ParameterValue
from gcs.links.autopilots import AUTOPILOTS
from gcs.model.preflight_report import Check, State
from gcs.preflight.autopilots import REQUIREMENTS
from gcs.preflight.autopilots.px4 import requirements
from gcs.preflight.parameters import broken, parameter_checks, requirements_of, settings_of
from gcs.preflight.requirement import Equipment, Requirement
from gcs.sim.cli import parameter, parameter_options
from gcs.sim.settings import Settings
from gcs.sim.vehicle.px4 import Parameters, defaults
from gcs.testing.virtual_show import show_config

OPERATION, CONTROL = OperationSettings(), ControlSettings()
VERSIONS = AUTOPILOTS["px4"].versions


def made(operation: OperationSettings) -> list[Requirement]:
    """Of the recorded version."""
    possible = VERSIONS.possible(VERSIONS.recorded.version)
    of_version = (one.of_versions(VERSIONS, possible) for one in requirements(operation, CONTROL, 30.0))
    return [one for one in of_version if one is not None]


NEEDED = made(OPERATION)
TO_DO = "install it as released"
GOOD = {each.name: each.set_to for each in NEEDED}


def needed(name: str, **operation: object) -> Requirement:
    settings = OperationSettings.model_validate(operation)
    return next(each for each in made(settings) if each.name == name)


def test_every_required_parameter_exists_in_px4_as_applied() -> None:
    for requirement in NEEDED:
        Parameters({requirement.name: requirement.set_to})
        assert type(defaults()[requirement.name]) is type(requirement.set_to), requirement.name


def test_check_accepts_what_apply_sets() -> None:
    assert broken(NEEDED, GOOD) == []
    for action in ("descend", "hold", "land", "return"):
        for loss_s in (0.5, 3.0, 10.0):
            settings = OperationSettings(setpoint_loss_action=action, setpoint_loss_s=loss_s)
            these = made(settings)
            assert broken(these, {each.name: each.set_to for each in these}) == []


def test_px4_defaults_are_refused_only_for_unsafe_values() -> None:
    found = [requirement.name for requirement, _ in broken(NEEDED, defaults())]
    assert found == [
        "COM_OBL_RC_ACT",
        "RTL_CONE_ANG",
        "COM_ARM_WO_GPS",
        "COM_RC_OVERRIDE",
        "GF_MAX_HOR_DIST",
        "GF_MAX_VER_DIST",
    ]


@pytest.mark.parametrize(("action", "number"), [("descend", 0), ("return", 3), ("land", 4), ("hold", 5)])
def test_action_is_the_configured_one_only(action: str, number: int) -> None:
    requirement = needed("COM_OBL_RC_ACT", setpoint_loss_action=action)
    assert [value for value in range(8) if requirement.holds(value)] == [number]


@pytest.mark.parametrize(
    ("action", "allowed"), [("descend", [0]), ("hold", [0, 1]), ("return", [0, 2]), ("land", [0, 3])]
)
def test_data_link_loss_action_equals_setpoint_loss_or_less(action: str, allowed: list[int]) -> None:
    requirement = needed("NAV_DLL_ACT", setpoint_loss_action=action)
    assert [value for value in range(8) if requirement.holds(value)] == allowed


@pytest.mark.parametrize(
    ("name", "bad", "good"),
    [
        ("COM_OF_LOSS_T", (0.3, 1.1, nan, inf), (0.5, 1.0)),
        ("COM_DL_LOSS_T", (1, 61), (2, 10, 60)),
        ("RTL_RETURN_ALT", (15.0, 31.0), (30.0,)),
        ("RTL_CONE_ANG", (25, 45, 90), (0,)),
        ("RTL_TYPE", (1, 2, 3, 4), (0,)),
        ("RTL_LAND_DELAY", (-1.0, 6.0), (0.0, 5.0)),
        ("MPC_XY_CRUISE", (5.1, 12.0), (3.0, 5.0)),
        ("COM_LOW_BAT_ACT", (0, 1, 4), (2, 3)),
        ("COM_ARM_WO_GPS", (1, 2), (0,)),
        ("COM_TAKEOFF_ACT", (1,), (0,)),
        ("COM_RC_IN_MODE", (4,), (0, 1, 2, 3)),
        ("COM_RC_OVERRIDE", (0, 1, 2), (3,)),
        ("MPC_XY_VEL_MAX", (5.0, 7.9), (8.0, 12.0)),
        ("MPC_Z_VEL_MAX_UP", (2.0,), (2.5, 3.0)),
        ("MPC_Z_VEL_MAX_DN", (1.0,), (1.4, 1.5)),
        ("MPC_TILTMAX_AIR", (20.0, 90.0), (35.0, 45.0)),
        ("MPC_ACC_HOR", (1.0,), (3.0,)),
        ("GF_ACTION", (0, 1, 3, 4, 5), (2,)),
        ("GF_MAX_HOR_DIST", (0.0, 300.0, 9999.0), (366.0, 500.0)),
        ("GF_MAX_VER_DIST", (0.0, 100.0, 9999.0), (108.0, 150.0)),
    ],
)
def test_each_parameter_has_its_bounds(name: str, bad: tuple[float, ...], good: tuple[float, ...]) -> None:
    assert [value for value in (*bad, *good) if needed(name).holds(value)] == list(good)


def test_geofence_is_outside_the_services_fence_for_all_pads() -> None:
    fence_m = CONTROL.safety.fence.distance_max_m
    near, far = needed("GF_MAX_HOR_DIST", pads_within_m=10.0), needed("GF_MAX_HOR_DIST", pads_within_m=80.0)
    assert far.set_to - near.set_to == pytest.approx(70.0)
    assert near.set_to > fence_m + 10.0 + CONTROL.safety.limits.horizontal_m_s
    assert needed("GF_MAX_VER_DIST", return_height_m=200.0).set_to > 200.0, "it may return above the fence"


@pytest.mark.parametrize(("autopilot", "name"), [("px4", "GF_MAX_VER_DIST"), ("ardupilot", "FENCE_ALT_MAX")])
def test_own_fence_ends_with_the_contingency_volume(autopilot: str, name: str) -> None:
    """Twice the height that is needed is allowed, but not above what was approved."""

    def highest_m(top_m: float) -> float:
        made = REQUIREMENTS[autopilot](OPERATION, CONTROL, 25.0, 245, Equipment(top_m=top_m))
        (own,) = (each for each in made if each.name == name)
        assert own.holds(own.set_to)
        return own.most

    free_m = highest_m(inf)
    assert highest_m(free_m - 20.0) == free_m - 20.0
    assert highest_m(1.0) == free_m / 2.0  # less than is needed is not asked for


def test_each_vehicle_returns_at_its_own_height() -> None:
    config = show_config(20)
    heights_m = [
        next(each.set_to for each in needed if each.name == "RTL_RETURN_ALT")
        for needed in requirements_of(config).values()
    ]
    assert heights_m[:3] == [30.0, 30.0, 34.0]
    assert np.ptp(heights_m) == 68.0, "17 layers of 4 m above the lowest, below the fence's 100 m"
    given = [parameter(word) for word in parameter_options(settings_of(config))[1::2]]
    fleet = Settings(count=20, parameters=dict(given))
    for index, needed in enumerate(requirements_of(config).values()):
        assert broken(needed, fleet.parameters_of(index)) == []
        height = next(each for each in needed if each.name == "RTL_RETURN_ALT")
        assert not height.holds(heights_m[index] + 4.0)


def test_without_a_pilot_stick_parameters_are_not_required() -> None:
    names = {each.name for each in made(OperationSettings(pilot_takes_over=False))}
    assert not names & {"COM_RC_IN_MODE", "COM_RC_OVERRIDE"}


def test_single_precision_rounding_is_not_a_wrong_value() -> None:
    assert needed("COM_OF_LOSS_T", setpoint_loss_s=0.7).holds(0.699999988079071)


def failed(read: dict[str, ParameterValue] | None, problem: str | None = None) -> list[Check]:
    return [check for check in parameter_checks(NEEDED, read, problem, TO_DO) if not check.passes]


def test_vehicle_not_yet_read_stays_on_the_ground() -> None:
    (check,) = failed(None)
    assert (check.state, check.problem) == (State.UNKNOWN, "parameters not read yet; it is being asked")
    (check,) = failed(None, "d1: parameter GF_ACTION: no answer")
    assert check.problem == "parameters not read yet: d1: parameter GF_ACTION: no answer"
    assert check.to_do == f"wait; if it stays so, {TO_DO}"


def test_wrong_value_names_the_right_one_and_its_command() -> None:
    first, second = failed(GOOD | {"COM_OBL_RC_ACT": 0, "GF_ACTION": 4})
    assert first.problem.startswith("COM_OBL_RC_ACT is 0, 5 is needed (")
    assert (first.name, first.value, first.limit) == ("parameters", 0.0, "COM_OBL_RC_ACT: 5")
    assert "GF_ACTION is 4, 2 is needed" in second.problem
    assert second.name == "own fence"
    assert "gcs params apply --config FILE" in first.to_do
    assert first.to_do == second.to_do


def test_a_parameter_that_the_vehicle_does_not_have_is_reported() -> None:
    without = {name: value for name, value in GOOD.items() if name != "GF_ACTION"}
    (check,) = failed(without)
    assert check.problem.startswith("GF_ACTION is not there, 2 is needed")
    assert check.to_do == TO_DO, "applying cannot help"


def test_correct_parameters_are_summarised_by_purpose_and_count() -> None:
    checks = parameter_checks(NEEDED, GOOD, None, TO_DO)
    assert {check.name for check in checks} == {"parameters", "speed limits", "own fence"}
    assert all(check.passes for check in checks)
    assert sum(check.value or 0.0 for check in checks) == len(NEEDED)
    (slow,) = failed(GOOD | {"MPC_XY_VEL_MAX": 3.0})
    assert (slow.name, slow.value) == ("speed limits", 3.0)
