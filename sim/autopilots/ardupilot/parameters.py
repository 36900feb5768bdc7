"""ArduCopter's parameters: those of the recorded 4.1-dev, in the order of its list, without another list.

Values are real numbers in PARAM_VALUE's float, whatever their type (habit 58).
"""

import math
from collections.abc import Mapping

from gcs.sim.vehicle import versions
from gcs.sim.vehicle.parameters import HALVES, ParameterList, Table, Value

NO_INDEX = 65535


def recorded() -> ParameterList:
    """The 1131 parameters that the recorded vehicle listed."""
    return versions.find("ardupilot").parameters


def defaults() -> Mapping[str, Value]:
    """The recorded values, read-only."""
    return recorded().defaults


class Parameters(Table):
    """One vehicle's parameters."""

    def __init__(
        self, settings: Mapping[str, Value] | None = None, listed: ParameterList | None = None
    ) -> None:
        """See `Table`. Raises: ParameterError as in `set`."""
        super().__init__(recorded() if listed is None else listed, settings)

    def assign(self, name: str, value: float) -> bool:
        """Change one value as PARAM_SET does (habit 59): whole numbers are cut and kept in their range.

        Returns: whether there is such a parameter and the value is a finite number; else nothing changes.
        """
        if name not in self.listed or not math.isfinite(value):
            return False
        half = HALVES.get(self.listed.kind(name))
        self._store(name, value if half is None else int(min(max(value, -half), half - 1)))
        return True
