"""What must hold of one parameter of an autopilot, and why. Pure.

Requirements are written in names and units of the autopilot's newest version. `of_versions` gives them those
of the versions that a vehicle may have.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, inf, isfinite
from typing import Final, NamedTuple

from gcs.links import ParameterValue
from gcs.links.autopilots.versions import Form, Release, Versions

NEARLY: Final = 1e-4
"""Relative tolerance: parameters are single precision."""


class Equipment(NamedTuple):
    """What a configuration has, beyond flying, that parameters must allow for."""

    polygons: bool = False  # a fence of polygons is uploaded
    remote_id: bool = False  # a start needs a transponder for Remote ID
    top_m: float = inf  # of the site's contingency volume above the origin; inf: it has none


@dataclass(frozen=True, slots=True)
class Requirement:
    """A parameter's requirement: within its bounds, one of `choices` if any, no bit of `without`."""

    name: str
    set_to: ParameterValue  # by `gcs params apply`; an int for an INT32
    why: str
    least: float = -inf
    most: float = inf
    choices: tuple[int, ...] = ()
    also: tuple[int, ...] = ()  # good besides what is within the bounds
    without: int = 0  # bits
    unit: str = ""
    risk: str = ""  # what remains unsafe where it does not hold, if a start is accepted all the same
    unless: str = ""  # a parameter that makes up for it with a value above 0
    alike: bool = False  # in a fleet of several autopilots all must have `set_to`, and nothing near it
    lacking: str | None = (
        None  # what remains unsafe on versions without it, "" nothing; None: it must be there
    )
    is_absent: bool = False  # none of the versions that it may have has this parameter
    otherwise: "Requirement | None" = None  # of other versions that it may have

    def holds(self, value: ParameterValue) -> bool:
        if not isfinite(value) or int(value) & self.without:
            return False
        if self.choices:
            return value in self.choices
        slack = NEARLY * max(1.0, abs(value))
        return value in self.also or self.least - slack <= value <= self.most + slack

    def is_met(self, values: Mapping[str, ParameterValue]) -> bool:
        """Whether it holds of a vehicle's values, or need not."""
        if self.name not in values:
            return self.lacking is not None
        return self.holds(values[self.name]) or values.get(self.unless, 0) > 0

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
        """Itself, and those under other names."""
        yield self
        if self.otherwise is not None:
            yield from self.otherwise.alternatives

    def of_values(self, values: Mapping[str, ParameterValue]) -> "Requirement":
        """The one of the alternatives that this vehicle has; the newest if it has none."""
        return next((each for each in self.alternatives if each.name in values), self)

    @property
    def desired(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        also = "".join(f", or {number}" for number in self.also)
        if self.choices:
            return " or ".join(str(choice) for choice in self.choices) + unit
        if self.without:
            bits = [str(bit) for bit in range(self.without.bit_length()) if self.without >> bit & 1]
            return f"without bit {' and '.join(bits)}"
        if self.least == self.most:
            return f"{self.least:g}{unit}"
        if isfinite(self.least) and isfinite(self.most):
            return f"{self.least:g} to {self.most:g}{unit}{also}"
        return f"{'at least' if isfinite(self.least) else 'at most'} {self._bound:g}{unit}{also}"

    @property
    def _bound(self) -> float:
        return self.least if isfinite(self.least) else self.most

    def of_versions(self, table: Versions, possible: Sequence[Release]) -> "Requirement | None":
        """In names and units of those versions; None where none has it and nothing is lost by that."""
        forms = [(each, form) for each in self.alternatives for form in table.forms(each.name, possible)]
        if not forms:
            return replace(self, is_absent=True) if self.lacking else None
        counting = [table.parameters[each.name].counts for each in self.alternatives]
        always = all(any(counts(release) for counts in counting) for release in possible)
        made: Requirement | None = None
        for each, form in reversed(forms):
            lacking = None if always else each.lacking or ""
            made = replace(each.under(form, table, possible), lacking=lacking, otherwise=made)
        return made

    def under(self, form: Form, table: Versions, possible: Sequence[Release]) -> "Requirement":
        """Under that name and in its unit, with the numbers that all of those versions know."""
        per_unit, values, knows = form.per_unit, form.values, table.parameters[self.name].knows
        known = [each for each in self.choices if all(knows(each, release) for release in possible)]
        set_to = self.set_to if per_unit == 1.0 else self.set_to * per_unit
        if form.whole:
            up = ceil(set_to - NEARLY)
            set_to = up if up <= self.most * per_unit + NEARLY else floor(set_to + NEARLY)
        if isinstance(set_to, int):
            set_to = values.get(set_to, set_to)
        return replace(
            self,
            name=form.name,
            unit=form.unit,
            set_to=set_to,
            least=self.least * per_unit,
            most=self.most * per_unit,
            choices=tuple(values.get(choice, round(choice * per_unit)) for choice in known),
        )
