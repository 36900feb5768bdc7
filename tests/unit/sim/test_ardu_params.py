"""ArduPilot's parameter table holds what the recorded vehicle listed, with its types (habits 58, 59)."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.sim.autopilots.ardupilot.parameters import Parameters, defaults, recorded
from gcs.sim.vehicle.parameters import ParameterError

INT8, INT16, INT32, REAL32 = 2, 4, 6, 9


def test_the_1131_recorded_parameters_are_there_with_their_types() -> None:
    kinds = [recorded().kind(name) for name in defaults()]
    assert len(kinds) == 1131
    assert [kinds.count(each) for each in (INT8, INT16, INT32, REAL32)] == [347, 298, 60, 426]
    assert (recorded().names[0], recorded().indices["SYSID_THISMAV"]) == ("FORMAT_VERSION", 1)
    assert (defaults()["WPNAV_ACCEL"], defaults()["SYSID_MYGCS"]) == (100.0, 255)


@pytest.mark.parametrize(
    "name", ["GUID_TIMEOUT", "FS_GCS_TIMEOUT", "MAV_GCS_SYSID", "PSC_JERK_XY", "FENCE_ALT_MIN", "_HASH_CHECK"]
)
def test_parameters_of_newer_versions_are_not_there(name: str) -> None:
    assert name not in defaults()
    assert not Parameters().assign(name, 1.0)


@pytest.mark.parametrize(
    ("name", "sent", "kept"),
    [
        ("FENCE_ACTION", 4.0, 4),
        ("FENCE_ACTION", 2.7, 2),
        ("FENCE_ACTION", 300.0, 127),
        ("FENCE_ACTION", -300.0, -128),
        ("FENCE_ACTION", 5.605193857299268e-45, 0),  # 4, byte-wise
        ("SYSID_MYGCS", 300.0, 300),
        ("FENCE_RADIUS", 150.5, 150.5),
    ],
)
def test_param_set_cuts_and_keeps_in_range(name: str, sent: float, kept: float) -> None:
    parameters = Parameters()
    assert parameters.assign(name, sent)
    assert parameters[name] == kept


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_no_number_change_nothing(value: float) -> None:
    parameters = Parameters()
    assert not parameters.assign("FENCE_RADIUS", value)
    assert parameters["FENCE_RADIUS"] == 150.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("NO_SUCH", 1.0),
        ("FENCE_RADIUS", math.nan),
        ("FENCE_RADIUS", 1e39),
        ("FENCE_ACTION", 0.5),
        ("FENCE_ACTION", 128),
    ],
)
def test_a_setting_that_it_cannot_hold_is_refused_by_name(name: str, value: float) -> None:
    parameters = Parameters()
    with pytest.raises(ParameterError, match=name):
        parameters.set(name, value)
    assert all(parameters[known] == default for known, default in defaults().items())


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_whole_parameters_stay_whole_and_in_their_range(value: float) -> None:
    parameters = Parameters()
    parameters.assign("SYSID_MYGCS", value)
    kept = parameters["SYSID_MYGCS"]
    assert isinstance(kept, int)
    assert -(2**15) <= kept < 2**15
