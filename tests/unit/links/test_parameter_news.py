"""What vehicles announce of their parameters is read alike by both transports, and kept bounded."""

import struct
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as dialect

from gcs.links.parameter_updates import ParameterNews
from gcs.links.udp.commands import PARAM_VALUE, parameter_values
from gcs.mavlink import codec
from gcs.mavlink.framing import parameter_value, split


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
def test_both_transports_read_parameters_alike(name: str, value: float, kind: int) -> None:
    data = announced(name, value, kind)
    (frame,) = split(data).frames
    found = codec.find(np.frombuffer(data, np.uint8), np.array([0]), np.array([len(data)]))
    messages = codec.decode(PARAM_VALUE, np.frombuffer(data, np.uint8), found.frames)
    assert parameter_value(frame) == (name, value)
    assert parameter_values(messages) == [(name, value)]
    assert isinstance(parameter_value(frame)[1], int) is (kind == 6)


def test_only_the_newest_watched_values_are_kept() -> None:
    news = ParameterNews()
    news.take("d1", "COM_OF_LOSS_T", 1.0)
    news.watch(["COM_OF_LOSS_T"])
    for value in range(1000):
        news.take("d1", "COM_OF_LOSS_T", float(value))
        news.take("d1", f"OTHER_{value}", 1)
    assert news.drain() == {"d1": {"COM_OF_LOSS_T": 999.0}}
    assert news.drain() == {}
