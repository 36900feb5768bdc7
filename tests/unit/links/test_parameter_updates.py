"""What vehicles announce of their parameters is read as PX4 encodes it, and kept bounded."""

import struct
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as dialect

from gcs.links.receiver import ParameterUpdates
from gcs.mavlink import codec
from gcs.mavlink.framing import PARAM_VALUE


def announced(name: str, value: float, kind: int) -> bytes:
    encoded = struct.unpack("<f", struct.pack("<i", value))[0] if kind == 6 else value
    message: Any = dialect.MAVLink_param_value_message(name.encode(), encoded, kind, 900, 7)
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=2, srcComponent=1)))


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("COM_OF_LOSS_T", 5.0, 9),
        ("COM_OBL_RC_ACT", 0, 6),
        ("COM_OBL_RC_ACT", -3, 6),
        ("SIXTEEN_LETTERS_", 1, 6),
    ],
)
def test_integers_and_floats_are_read(name: str, value: float, kind: int) -> None:
    data = announced(name, value, kind)
    found = codec.find(np.frombuffer(data, np.uint8), np.array([0]), np.array([len(data)]))
    messages = codec.decode(PARAM_VALUE, np.frombuffer(data, np.uint8), found.frames)
    assert codec.parameter_values(messages) == [(name, value)]
    assert isinstance(codec.parameter_values(messages)[0][1], int) is (kind == 6)


def test_only_the_newest_watched_values_are_kept() -> None:
    updates = ParameterUpdates(["d1"])
    updates.take(0, "COM_OF_LOSS_T", 1.0)
    updates.watch(["COM_OF_LOSS_T"])
    for value in range(1000):
        updates.take(0, "COM_OF_LOSS_T", float(value))
        updates.take(0, f"OTHER_{value}", 1)
    assert updates.drain() == {"d1": {"COM_OF_LOSS_T": 999.0}}
    assert updates.drain() == {}
