"""The parameter table holds what PX4 lists, and only takes what PX4 would."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.sim.vehicle.parameters import INT32, REAL32, ParameterError
from gcs.sim.vehicle.px4 import Parameters, decoded_value, defaults, encoded_value

LISTED = Parameters().listed


def through_the_frame(name: str, value: float) -> float:
    """As the float field of PARAM_VALUE carries it."""
    kind = LISTED.kind(name)
    return float(struct.unpack("<f", struct.pack("<f", encoded_value(kind, value)))[0])


def test_every_recorded_parameter_survives_encoding() -> None:
    for name, value in defaults().items():
        kind = LISTED.kind(name)
        back = decoded_value(kind, kind, through_the_frame(name, value))
        assert back == (value if kind == INT32 else pytest.approx(value, rel=1e-6))


def test_the_recorded_defaults_are_there() -> None:
    parameters = Parameters()
    assert len(defaults()) == 905
    assert (parameters["COM_OF_LOSS_T"], parameters["COM_OBL_RC_ACT"], parameters["MPC_XY_VEL_MAX"]) == (
        1.0,
        0,
        12.0,
    )


@given(st.integers(-(2**31), 2**31 - 1).filter(lambda bits: bits & 0x7F800000 != 0x7F800000))
def test_integer_parameters_travel_bytewise(value: int) -> None:
    assert decoded_value(INT32, INT32, through_the_frame("COM_OBL_RC_ACT", value)) == value


@pytest.mark.parametrize(
    ("name", "value"),
    [("NO_SUCH", 1.0), ("MPC_XY_VEL_MAX", float("nan")), ("MPC_XY_VEL_MAX", 1e39), ("COM_OBL_RC_ACT", 0.5)],
)
def test_value_that_px4_rejects_is_refused_by_name(name: str, value: float) -> None:
    parameters = Parameters()
    with pytest.raises(ParameterError, match=name):
        parameters.set(name, value)
    assert all(parameters[known] == default for known, default in defaults().items())


def test_a_value_of_the_wrong_type_is_refused() -> None:
    with pytest.raises(ParameterError, match="MAV_PARAM_TYPE 9 is needed, not 6"):
        decoded_value(REAL32, INT32, 1.0)
    assert decoded_value(REAL32, REAL32, 1.5) == 1.5


def test_indices_and_names_correspond() -> None:
    assert [LISTED.names[LISTED.indices[name]] for name in defaults()] == list(defaults())
    assert list(defaults()) == sorted(defaults())


def test_two_vehicles_do_not_share_their_parameters() -> None:
    one, other = Parameters(), Parameters()
    one.set("COM_OF_LOSS_T", 3.0)
    assert other["COM_OF_LOSS_T"] == 1.0
