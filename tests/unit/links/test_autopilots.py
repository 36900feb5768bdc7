"""What is known of each autopilot."""

import pytest

from gcs.links.autopilots import DEFAULT
from gcs.model.state import Mode


@pytest.mark.parametrize(
    ("main", "sub", "mode"),
    [
        (6, 0, Mode.OFFBOARD),
        (4, 2, Mode.TAKEOFF),
        (4, 3, Mode.HOLD),
        (4, 5, Mode.RETURN),
        (4, 6, Mode.LAND),
        (3, 0, Mode.POSITION),
        (4, 1, Mode.READY),
        (4, 4, Mode.OTHER),
        (1, 0, Mode.OTHER),
    ],
)
def test_px4_modes_have_our_names(main: int, sub: int, mode: Mode) -> None:
    assert DEFAULT.mode(main << 16 | sub << 24) is mode
