"""What preflight says: of each vehicle and of the fleet, check by check, and who has been taken out.

Plain data, for the interface above control. What is checked, and how, is `gcs.preflight`'s.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from gcs.model.state import VehicleId


class State(StrEnum):
    """How a check came out. What is not known counts as failed."""

    PASS = "pass"  # noqa: S105 (no password)
    FAIL = "fail"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at."""

    name: str
    state: State
    value: float | None = None  # as measured; None: not known, or no number
    unit: str = ""
    limit: str = ""  # what passes, in words, with its unit
    problem: str = ""  # what is wrong, in words; empty when it passes
    to_do: str = ""  # what mends it

    @property
    def passes(self) -> bool:
        """Whether nothing speaks against a start."""
        return self.state is State.PASS


@dataclass(frozen=True, slots=True)
class VehicleChecks:
    """One vehicle before take-off."""

    id: VehicleId
    flies: bool
    reason: str  # why it does not fly; empty when it does
    checks: tuple[Check, ...]

    @property
    def failed(self) -> tuple[Check, ...]:
        """What keeps it on the ground, if it flies."""
        return tuple(check for check in self.checks if not check.passes)


@dataclass(frozen=True, slots=True)
class PreflightReport:
    """Everything that is looked at before a start."""

    unix_time_s: float  # when
    show: str | None  # the selected one
    show_hash: str | None
    fleet: tuple[Check, ...]
    vehicles: tuple[VehicleChecks, ...]
    not_checked: tuple[str, ...]  # what is not looked at, and why

    @property
    def passes(self) -> bool:
        """Whether a start would be accepted: nothing fails, of the fleet or of anybody who flies."""
        flying = [vehicle for vehicle in self.vehicles if vehicle.flies]
        sound = all(check.passes for check in self.fleet)
        return sound and bool(flying) and not any(vehicle.failed for vehicle in flying)


@dataclass(frozen=True, slots=True)
class Exclusion:
    """A vehicle was taken out of the show."""

    by: str  # who did it: see `gcs.service.WHO`
    reason: str
    unix_time_s: float

    def __str__(self) -> str:
        why = f": {self.reason}" if self.reason else ""
        return f"taken out of the show by {self.by}{why}"


def describe(found: Iterable[tuple[VehicleId | None, Check]]) -> str:
    """What is wrong and then what to do, in words; what several vehicles share is said once.

    None in place of a vehicle stands for the fleet. Checks that pass are left out.
    """
    failed = [(vehicle_id, check) for vehicle_id, check in found if not check.passes]
    problems = _grouped((vehicle_id, check.problem) for vehicle_id, check in failed)
    mends = _grouped((vehicle_id, check.to_do) for vehicle_id, check in failed if check.to_do)
    return "; ".join([*problems, *mends])


def _grouped(lines: Iterable[tuple[VehicleId | None, str]]) -> list[str]:
    whose: dict[str, list[VehicleId]] = {}
    for vehicle_id, text in lines:
        names = whose.setdefault(text, [])
        if vehicle_id is not None and vehicle_id not in names:
            names.append(vehicle_id)
    return [f"{joined(names)}: {text}" if names else text for text, names in whose.items()]


def joined(names: Sequence[VehicleId]) -> str:
    """With commas."""
    return ", ".join(names)
