"""Where in a record a replay is, and what it is ordered. Times are the loop's, given from outside."""

from math import inf, isfinite
from typing import Final

from gcs.model.errors import InvalidError, RefusedError

SPEED_MAX: Final = 100.0


class Playhead:
    """Moves through a record at its speed, unless it is paused."""

    def __init__(self, duration_s: float, speed: float, now_s: float) -> None:
        """At the beginning, moving. Raises: InvalidError for a speed that is none."""
        _check_speed(speed)
        self.duration_s = duration_s
        self.speed = speed
        self.paused = False
        self._at_s = 0.0  # where it was
        self._since_s = now_s  # then

    def position_s(self, now_s: float) -> float:
        """Since the first recorded state."""
        moved_s = 0.0 if self.paused else (now_s - self._since_s) * self.speed
        return min(self._at_s + moved_s, self.duration_s)

    def left_s(self, position_s: float, now_s: float) -> float:
        """How long until it is there, at this speed; negative: since when it is, inf: never."""
        way_s = position_s - self.position_s(now_s)
        if way_s <= 0.0:
            return way_s / self.speed
        return inf if self.paused else way_s / self.speed

    def change(
        self, now_s: float, *, paused: bool | None, speed: float | None, position_s: float | None
    ) -> None:
        """Move otherwise from now on. Raises: InvalidError, RefusedError; then nothing has changed."""
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
    if not 0.0 < speed <= SPEED_MAX:  # so written that NaN is none
        raise InvalidError("speed", speed, f"above 0, at most {SPEED_MAX:g}")
