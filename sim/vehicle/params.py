"""The parameters of PX4 v1.16.1, typed, as one vehicle holds them.

The table is what a PX4 v1.16.1 SITL listed (px4_params.json: integers are INT32, the others FLOAT).
"""

from __future__ import annotations

import json
import math
import struct
from functools import cache, partial
from importlib import resources
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from gcs.sim.vehicle.dynamics import Array

Value: TypeAlias = int | float

INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE
INT32_RANGE = range(-(2**31), 2**31)
REAL32_MAX = 3.4028234e38


class ParameterError(ValueError):
    """A parameter does not exist, or does not accept that value."""


@cache
def defaults() -> Mapping[str, Value]:
    """The recorded table, sorted by name, read-only."""
    text = resources.files("gcs.sim").joinpath("px4_params.json").read_text(encoding="ascii")
    table: dict[str, Value] = json.loads(text)
    return MappingProxyType(dict(sorted(table.items())))


@cache
def _indices() -> Mapping[str, int]:
    return MappingProxyType({name: index for index, name in enumerate(defaults())})


class Parameters:
    """One vehicle's parameters. Only existing ones can be set, only to finite values of their type."""

    def __init__(self, settings: Mapping[str, Value] | None = None) -> None:
        """Start from the defaults, changed by settings.

        Raises:
            ParameterError: as in set.
        """
        self._changed: dict[str, Value] = {}
        self.on_change: Callable[[str, Value], None] | None = None
        for name, value in (settings or {}).items():
            self.set(name, value)

    def __len__(self) -> int:
        """How many parameters there are."""
        return len(defaults())

    def __contains__(self, name: object) -> bool:
        """Whether there is such a parameter."""
        return name in defaults()

    def __getitem__(self, name: str) -> Value:
        """The value; KeyError where there is no such parameter."""
        value = self._changed.get(name)
        return defaults()[name] if value is None else value

    def names(self) -> Iterable[str]:
        """All names, in the order of their indices."""
        return defaults().keys()

    def set(self, name: str, value: Value) -> None:
        """Change one value.

        Raises:
            ParameterError: no such parameter, or a value that is not finite, not in range, or (for an
                INT32) not whole.
        """
        if name not in defaults():
            raise ParameterError(f"{name}: PX4 v1.16 has no such parameter")
        if not math.isfinite(value) or abs(value) > REAL32_MAX:
            raise ParameterError(f"{name}: {value} is not a finite number that a parameter can hold")
        if kind(name) == INT32:
            if value != int(value) or int(value) not in INT32_RANGE:
                raise ParameterError(f"{name}: {value} is not a whole number of 32 bits")
            self._changed[name] = int(value)
        else:
            self._changed[name] = float(value)
        if self.on_change is not None:
            self.on_change(name, self._changed[name])


class Columns:
    """The parameters of a fleet as (n,) arrays, for values computed for all vehicles at once.

    A column is created on first use, and follows every change of a vehicle's own table.
    """

    def __init__(self, vehicles: Sequence[Parameters]) -> None:
        """Row i is vehicles[i], whose changes are followed from now on."""
        self._vehicles = vehicles
        self._columns: dict[str, Array] = {}
        self._axes: dict[tuple[str, str], Array] = {}
        for row, parameters in enumerate(vehicles):
            parameters.on_change = partial(self._change, row)

    def __getitem__(self, name: str) -> Array:
        """(n,), read-only by agreement; KeyError where there is no such parameter."""
        column = self._columns.get(name)
        if column is None:
            column = np.array([parameters[name] for parameters in self._vehicles], dtype=np.float64)
            self._columns[name] = column
        return column

    def axes(self, across: str, down: str) -> Array:
        """(n, 3), read-only by agreement: one parameter for north and east, one for down."""
        both = self._axes.get((across, down))
        if both is None:
            both = np.stack([self[across], self[across], self[down]], axis=1)
            self._axes[across, down] = both
        return both

    def _change(self, row: int, name: str, value: Value) -> None:
        self._axes = {names: both for names, both in self._axes.items() if name not in names}
        if name in self._columns:
            self._columns[name][row] = value


def kind(name: str) -> int:
    """INT32 or REAL32."""
    return INT32 if isinstance(defaults()[name], int) else REAL32


def index(name: str) -> int:
    """The place of a parameter in the list."""
    return _indices()[name]


def name_at(place: int) -> str | None:
    """The parameter at that place in the list, or None."""
    names = tuple(defaults())
    return names[place] if 0 <= place < len(names) else None


def encoded_value(name: str, value: Value) -> float:
    """PX4's bytewise encoding: the float field contains an INT32's four bytes."""
    if kind(name) == REAL32:
        return float(value)
    return float(struct.unpack("<f", struct.pack("<i", int(value)))[0])


def decoded_value(name: str, param_type: int, value: float) -> Value:
    """Undo encoded_value.

    Raises:
        ParameterError: the sender uses another type for this parameter.
    """
    if param_type != kind(name):
        raise ParameterError(f"{name} is of MAV_PARAM_TYPE {kind(name)}, not {param_type}")
    if param_type == REAL32:
        return value
    return int(struct.unpack("<i", struct.pack("<f", value))[0])
