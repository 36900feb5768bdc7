"""Result of the preflight checks, of each vehicle and of the fleet, and the exclusion of a vehicle.

Types only, for all packages from the checks (`gcs.preflight`) to displays.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Final

from pydantic import Field, computed_field

from gcs.model.settings import PUBLISHED, Measured
from gcs.model.state import VehicleId


class State(StrEnum):
    """Result of a check. Unknown counts as failed."""

    PASS = "pass"  # noqa: S105 (no password)
    FAIL = "fail"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Check:
    """One check before a start."""

    __pydantic_config__ = PUBLISHED

    name: str
    state: Annotated[State, Field(description="Result of the check; unknown counts as failed.")]
    value: Annotated[Measured, Field(description="The measured value; null: not known, or no number.")] = None
    unit: str = ""
    limit: Annotated[str, Field(description="Values that pass.")] = ""
    problem: Annotated[str, Field(description="What is wrong; empty when it passes.")] = ""
    to_do: Annotated[str, Field(description="How to correct it.")] = ""
    depends_on: Annotated[
        tuple[str, ...],
        Field(description="Other checks of the same vehicle, or vehicles, from which a failure follows."),
    ] = ()

    @property
    def passes(self) -> bool:
        return self.state is State.PASS


@dataclass(frozen=True, slots=True)
class VehicleChecks:
    """All checks of one vehicle before a start."""

    id: VehicleId
    flies: Annotated[
        bool,
        Field(
            description="Whether the vehicle takes part in a start when every check passes. A silent one"
            " does, and fails, until it is left out."
        ),
    ]
    reason: Annotated[str, Field(description="Why it does not fly.")]
    checks: tuple[Check, ...]
    autopilot: Annotated[str, Field(description="Name of its profile, as configured.")] = ""
    version: Annotated[str, Field(description="Its autopilot's version, as reported; empty: not yet.")] = ""

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that keep it on the ground, if it takes part."""
        return tuple(check for check in self.checks if not check.passes)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def passes(self) -> bool:
        return not self.failed


class Remedy(StrEnum):
    """A command of the service that mends a cause."""

    LEAVE_OUT = "leave-out"  # exclude the vehicles
    CONFIRM_DOWN = "confirm-down"  # the vehicles, once they are seen on the ground
    SET_RADIUS = "set-radius"  # of the formation
    REMOVE_OBSTACLE = "remove-obstacle"


@dataclass(frozen=True, slots=True)
class PreflightAction:
    """What mends most of a cause at once, and what remains then."""

    __pydantic_config__ = PUBLISHED

    remedy: Remedy
    label: Annotated[str, Field(examples=["Leave d3 out"])]
    then: Annotated[str, Field(description="The report once it is done.", examples=["ready"])]
    vehicles: tuple[VehicleId, ...] = ()
    radius_m: float | None = None
    obstacle: str = ""


@dataclass(frozen=True, slots=True)
class PreflightCause:
    """One thing to mend, with all that follows from it."""

    __pydantic_config__ = PUBLISHED

    check: Annotated[str, Field(description="Name of the check that fails.")]
    state: State
    text: Annotated[str, Field(examples=["d3: its receiver's fix is 2D, 3D is needed"])]
    to_do: Annotated[str, Field(description="How to correct it.")]
    vehicles: Annotated[tuple[VehicleId, ...], Field(description="Empty: it concerns the fleet.")]
    follows: Annotated[tuple[str, ...], Field(description="What fails because of it, one text a check.")]
    action: Annotated[
        PreflightAction | None, Field(description="null: no command of the service mends it.")
    ] = None


READY: Final = "ready"


@dataclass(frozen=True, slots=True)
class PreflightReport:
    """All checks before a start."""

    unix_time_s: Annotated[float, Field(description="Time of the check; in the air: before take-off.")]
    show: str | None  # the selected one
    show_hash: str | None
    fleet: tuple[Check, ...]
    vehicles: tuple[VehicleChecks, ...]
    not_checked: Annotated[tuple[str, ...], Field(description="What is not checked, and why.")]
    causes: Annotated[
        tuple[PreflightCause, ...],
        Field(description="What to mend, what helps most first; every check that fails is in one of them."),
    ] = ()
    in_flight: Annotated[
        str,
        Field(description="Why a start is refused whatever the checks say: it flies. Empty: it does not."),
    ] = ""

    @computed_field  # type: ignore[prop-decorator]
    @property
    def not_flying(self) -> dict[VehicleId, str]:
        """Vehicles that would stay on the ground, and why."""
        return {vehicle.id: vehicle.reason for vehicle in self.vehicles if not vehicle.flies}

    @computed_field  # type: ignore[prop-decorator]
    @property
    def passes(self) -> bool:
        """Whether a start would be accepted now: no check of the fleet or of a vehicle that flies fails."""
        flying = [vehicle for vehicle in self.vehicles if vehicle.flies]
        sound = not self.in_flight and all(check.passes for check in self.fleet)
        return sound and bool(flying) and not any(vehicle.failed for vehicle in flying)

    @property
    def in_short(self) -> str:
        """Why a start would be refused: what to mend first, and how many causes more; empty: it would not."""
        if self.passes:
            return ""
        more = f" (+{len(self.causes) - 1})" if len(self.causes) > 1 else ""
        first = self.causes[0].text if self.causes else self.in_flight or "no vehicle is left"
        return f"{first}{more}"


@dataclass(frozen=True, slots=True)
class Exclusion:
    """The exclusion of a vehicle from the show."""

    by: str  # the caller: see `gcs.service.CALLER`
    reason: str
    unix_time_s: float

    def __str__(self) -> str:
        why = f": {self.reason}" if self.reason else ""
        return f"taken out of the show by {self.by}{why}"


NAMED_MAX: Final = 12
"""Up to this many vehicles are named in a text; of more it has the number."""


def describe(checks: Iterable[tuple[VehicleId | None, Check]]) -> str:
    """All problems and then all remedies, in words; text that several vehicles share appears once.

    None in place of a vehicle stands for the fleet. Checks that pass are left out.
    """
    failed = [(vehicle_id, check) for vehicle_id, check in checks if not check.passes]
    problems = _grouped((vehicle_id, check.problem) for vehicle_id, check in failed)
    remedies = _grouped((vehicle_id, check.to_do) for vehicle_id, check in failed if check.to_do)
    return "; ".join([*problems, *remedies])


def _grouped(lines: Iterable[tuple[VehicleId | None, str]]) -> list[str]:
    vehicles_of: dict[str, list[VehicleId]] = {}
    for vehicle_id, text in lines:
        names = vehicles_of.setdefault(text, [])
        if vehicle_id is not None and vehicle_id not in names:
            names.append(vehicle_id)
    return [f"{named(names)}: {text}" if names else text for text, names in vehicles_of.items()]


def named(names: Sequence[VehicleId]) -> str:
    """The vehicles separated by commas, the first of many and how many more."""
    more = f" and {len(names) - NAMED_MAX} more" if len(names) > NAMED_MAX else ""
    return ", ".join(names[:NAMED_MAX]) + more
