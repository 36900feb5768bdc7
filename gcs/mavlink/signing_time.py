"""The time of MAVLink 2 signatures."""

from typing import Final

KEY_BYTES: Final = 32
EPOCH_S: Final = 1_420_070_400  # 2015-01-01 in Unix time; a signature's time counts 10 us from here
UNITS_PER_S: Final = 100_000
TIME_MAX: Final = (1 << 48) - 1


def signing_time(unix_s: float) -> int:
    return min(TIME_MAX, max(0, round((unix_s - EPOCH_S) * UNITS_PER_S)))
