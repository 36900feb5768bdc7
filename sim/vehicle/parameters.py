"""Parameters: the list of one version of an autopilot, one vehicle's table, and a fleet's columns.

The model reads each by the name and unit of the recorded version; only the link knows those of others.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from gcs.sim.vehicle.dynamics import Array

Value: TypeAlias = int | float

INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE
HALVES = MappingProxyType({2: 2**7, 4: 2**15, INT32: 2**31})
"""Half the number of values of INT8, INT16 and INT32."""
REAL32_MAX = 3.4028234e38


class ParameterError(ValueError):
    """A parameter does not exist, or does not accept that value."""


@dataclass(frozen=True, slots=True)
class Renamed:
    """A parameter of a version that does what a recorded one did."""

    name: str
    to_own: Callable[[Value], Value]
    to_recorded: Callable[[Value], Value]


@dataclass(frozen=True, eq=False)
class ParameterList:
    """The parameters of one version, in the order of its list.

    Attributes:
        title: of the version, for messages.
        listed: MAV_PARAM_TYPE and default by name.
        renamed: by recorded name.
        without: what the version does where a recorded or later parameter does not exist, by that name.
    """

    title: str
    listed: Mapping[str, tuple[int, Value]]
    renamed: Mapping[str, Renamed] = field(default_factory=dict)
    without: Mapping[str, Value] = field(default_factory=dict)

    def __deepcopy__(self, _memo: object) -> "ParameterList":
        """Itself: it never changes."""
        return self

    def __contains__(self, name: object) -> bool:
        return name in self.listed

    def __len__(self) -> int:
        return len(self.listed)

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(self.listed)

    @cached_property
    def defaults(self) -> Mapping[str, Value]:
        return MappingProxyType({name: value for name, (_, value) in self.listed.items()})

    @cached_property
    def indices(self) -> Mapping[str, int]:
        return {name: place for place, name in enumerate(self.listed)}

    @cached_property
    def recorded_names(self) -> Mapping[str, str]:
        """The recorded names of those that were renamed, by the version's own."""
        return {each.name: recorded for recorded, each in self.renamed.items()}

    def kind(self, name: str) -> int:
        """MAV_PARAM_TYPE of an existing parameter."""
        return self.listed[name][0]

    def knows(self, name: str) -> bool:
        """Whether there is such a parameter, or one that replaces it."""
        return name in self.listed or name in self.renamed

    def own(self, name: str, value: Value) -> tuple[str, Value]:
        """Name and value of this version, of a parameter that may have its recorded name."""
        renamed = self.renamed.get(name)
        return (name, value) if renamed is None else (renamed.name, renamed.to_own(value))


class Table:
    """One vehicle's parameters: `table[name]` by recorded names and units, all else by the version's own."""

    def __init__(self, listed: ParameterList, settings: Mapping[str, Value] | None = None) -> None:
        """Start from the defaults, changed by settings. Raises: ParameterError as in `set`."""
        self.listed = listed
        self._changed: dict[str, Value] = {}
        self.on_change: Callable[[str, Value], None] | None = None
        for name, value in (settings or {}).items():
            self.set(name, value)

    def __getitem__(self, recorded: str) -> Value:
        """The value in the recorded unit; KeyError where nothing of the version corresponds to it."""
        renamed = self.listed.renamed.get(recorded)
        if renamed is not None:
            return renamed.to_recorded(self.own(renamed.name))
        return self.own(recorded) if recorded in self.listed else self.listed.without[recorded]

    def own(self, name: str) -> Value:
        """The value as the version has it. Raises: KeyError."""
        value = self._changed.get(name)
        return self.listed.defaults[name] if value is None else value

    def set(self, name: str, value: Value) -> None:
        """Change one value, also by its recorded name and unit.

        Raises: ParameterError: no such parameter, or a value that it cannot hold exactly (REAL32: finite).
        """
        name, value = self.listed.own(name, value)
        if name not in self.listed:
            raise ParameterError(f"{name}: {self.listed.title} has no such parameter")
        if not math.isfinite(value) or abs(value) > REAL32_MAX:
            raise ParameterError(f"{name}: {value} is not a finite number that a parameter can hold")
        half = HALVES.get(self.listed.kind(name))
        if half is not None and not (value == int(value) and -half <= value < half):
            raise ParameterError(f"{name}: {value} is not a whole number from {-half} to {half - 1}")
        self._store(name, value)

    def _store(self, name: str, value: Value) -> None:
        self._changed[name] = float(value) if self.listed.kind(name) == REAL32 else int(value)
        if self.on_change is not None:
            recorded = self.listed.recorded_names.get(name, name)
            self.on_change(recorded, self[recorded])


class Columns:
    """The parameters of a fleet as (n,) arrays, for values computed for all vehicles at once.

    A column is created on first use, and follows every change of a vehicle's own table.
    """

    def __init__(self, vehicles: Sequence[Table]) -> None:
        """Row i is vehicles[i], whose changes are followed from now on."""
        self._vehicles = vehicles
        self._columns: dict[str, Array] = {}
        self._axes: dict[tuple[str, str], Array] = {}
        for row, parameters in enumerate(vehicles):
            parameters.on_change = partial(self._change, row)

    def __getitem__(self, name: str) -> Array:
        """(n,), read-only by agreement, by the recorded name and in its unit; KeyError as in `Table`."""
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
