"""What must hold of one parameter of an autopilot, and why. Pure."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Final

from gcs.links import ParameterValue

NEARLY: Final = 1e-4
"""Relative tolerance: parameters are single precision."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """A parameter's requirement: within its bounds, one of `choices` if any, none of `barred`."""

    name: str
    set_to: ParameterValue  # by `gcs params apply`; an int for an INT32
    why: str
    least: float = -inf
    most: float = inf
    choices: tuple[int, ...] = ()
    barred: tuple[int, ...] = ()
    otherwise: "Requirement | None" = None  # of versions of the autopilot that do not have this parameter
    alike: bool = False  # in a fleet of several autopilots all must have `set_to`, and nothing near it
    lacking: str | None = (
        None  # what remains unsafe on versions without it, "" nothing; None: it must be there
    )

    def holds(self, value: ParameterValue) -> bool:
        if not isfinite(value) or value in self.barred:
            return False
        if self.choices:
            return value in self.choices
        slack = NEARLY * max(1.0, abs(value))
        return self.least - slack <= value <= self.most + slack

    @property
    def exactly(self) -> "Requirement":
        """The same, met by `set_to` only."""
        return replace(self, least=float(self.set_to), most=float(self.set_to))

    @property
    def may_lack(self) -> bool:
        """Whether a vehicle need not have it."""
        return self.otherwise is not None or self.lacking is not None

    @property
    def alternatives(self) -> Iterator["Requirement"]:
        """Itself, and those of other versions."""
        yield self
        if self.otherwise is not None:
            yield from self.otherwise.alternatives

    def of_version(self, values: Mapping[str, ParameterValue]) -> "Requirement":
        """The one of the alternatives that this vehicle has; the last if it has none."""
        return next((each for each in self.alternatives if each.name in values), [*self.alternatives][-1])

    @property
    def desired(self) -> str:
        if self.choices:
            return " or ".join(str(choice) for choice in self.choices)
        if self.barred:
            return f"not {' nor '.join(str(number) for number in self.barred)}"
        if self.least == self.most:
            return f"{self.least:g}"
        if isfinite(self.least) and isfinite(self.most):
            return f"{self.least:g} to {self.most:g}"
        return f"at least {self.least:g}" if isfinite(self.least) else f"at most {self.most:g}"
