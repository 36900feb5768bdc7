"""The position of a replay in its record. Times are the loop's, passed by the caller."""

from math import inf, isfinite
from typing import Final

from gcs.model.errors import InvalidError, RefusedError

SPEED_MAX: Final = 100.0


class Playhead:
    """Moves through a record at its speed, unless it is paused."""

    def __init__(self, duration_s: float, speed: float, now_s: float) -> None:
        """Starts at the beginning, moving. Raises: InvalidError for an invalid speed."""
        _check_speed(speed)
        self.duration_s = duration_s
        self.speed = speed
        self.paused = False
        self._at_s = 0.0  # position at `_since_s`
        self._since_s = now_s  # loop time

    def position_s(self, now_s: float) -> float:
        """Position since the first recorded state, in s."""
        moved_s = 0.0 if self.paused else (now_s - self._since_s) * self.speed
        return min(self._at_s + moved_s, self.duration_s)

    def left_s(self, position_s: float, now_s: float) -> float:
        """Time until that position at this speed; negative: it has passed, inf: never."""
        way_s = position_s - self.position_s(now_s)
        if way_s <= 0.0:
            return way_s / self.speed
        return inf if self.paused else way_s / self.speed

    def change(
        self, now_s: float, *, paused: bool | None, speed: float | None, position_s: float | None
    ) -> None:
        """Change the playback from now on. Raises: InvalidError, RefusedError; then nothing has changed."""
        if speed is not None:
            _check_speed(speed)
        if position_s is not None and not (isfinite(position_s) and 0.0 <= position_s <= self.duration_s):
            raise InvalidError("position_s", position_s, f"from 0 to {self.duration_s:.2f}, its duration")
        here_s = self.position_s(now_s)
        if paused is False and position_s is None and here_s >= self.duration_s:
            raise RefusedError("the record has ended: give position_s to play it again from there")
        self._at_s = here_s if position_s is None else position_s
        self._since_s = now_s
        self.speed = self.speed if speed is None else speed
        self.paused = self.paused if paused is None else paused


def _check_speed(speed: float) -> None:
    if not 0.0 < speed <= SPEED_MAX:  # written so that NaN is refused
        raise InvalidError("speed", speed, f"above 0, at most {SPEED_MAX:g}")
