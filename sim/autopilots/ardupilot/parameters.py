"""ArduCopter's parameters: the 1131 that a recorded 4.1-dev SITL listed, in the order of its list.

Values are real numbers in PARAM_VALUE's float, whatever their type (habit 58).
"""

import json
import math
from collections.abc import Callable, Mapping
from functools import cache
from importlib import resources
from types import MappingProxyType

from gcs.sim.vehicle.px4 import REAL32_MAX, ParameterError, Value

REAL32 = 9
RANGES = MappingProxyType({2: 2**7, 4: 2**15, 6: 2**31})
"""Half the number of values of INT8, INT16 and INT32, by MAV_PARAM_TYPE."""
NO_INDEX = 65535


@cache
def _recorded() -> Mapping[str, tuple[int, Value]]:
    """Type (MAV_PARAM_TYPE) and default by name."""
    text = resources.files("gcs.sim.autopilots.ardupilot").joinpath("parameters.json").read_text("ascii")
    table: dict[str, tuple[int, Value]] = json.loads(text)
    return MappingProxyType({name: (kind, value) for name, (kind, value) in table.items()})


@cache
def defaults() -> Mapping[str, Value]:
    """The recorded values, read-only."""
    return MappingProxyType({name: value for name, (_, value) in _recorded().items()})


@cache
def names() -> tuple[str, ...]:
    """In the order of the list."""
    return tuple(_recorded())


@cache
def index(name: str) -> int:
    return names().index(name)


def kind(name: str) -> int:
    """MAV_PARAM_TYPE of an existing parameter."""
    return _recorded()[name][0]


class Parameters:
    """One vehicle's parameters."""

    def __init__(self, settings: Mapping[str, Value] | None = None) -> None:
        """Start from the defaults, changed by settings. Raises: ParameterError as in `set`."""
        self._changed: dict[str, Value] = {}
        self.on_change: Callable[[str, Value], None] | None = None
        for name, value in (settings or {}).items():
            self.set(name, value)

    def __getitem__(self, name: str) -> Value:
        """The value; KeyError where there is no such parameter."""
        value = self._changed.get(name)
        return defaults()[name] if value is None else value

    def set(self, name: str, value: Value) -> None:
        """Change one value.

        Raises: ParameterError: no such parameter, or a value that it cannot hold exactly (REAL32: finite).
        """
        if name not in defaults():
            raise ParameterError(f"{name}: ArduCopter 4.1 has no such parameter")
        if not math.isfinite(value) or abs(value) > REAL32_MAX:
            raise ParameterError(f"{name}: {value} is not a finite number that a parameter can hold")
        half = RANGES.get(kind(name))
        if half is not None and not (value == int(value) and -half <= value < half):
            raise ParameterError(f"{name}: {value} is not a whole number from {-half} to {half - 1}")
        self._change(name, value)

    def assign(self, name: str, value: float) -> bool:
        """Change one value as PARAM_SET does (habit 59): whole numbers are cut and kept in their range.

        Returns: whether there is such a parameter and the value is a finite number; else nothing changes.
        """
        if name not in defaults() or not math.isfinite(value):
            return False
        half = RANGES.get(kind(name))
        self._change(name, value if half is None else int(min(max(value, -half), half - 1)))
        return True

    def _change(self, name: str, value: float) -> None:
        self._changed[name] = float(value) if kind(name) == REAL32 else int(value)
        if self.on_change is not None:
            self.on_change(name, self._changed[name])
