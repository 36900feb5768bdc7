"""JSON schemas of preflight: the checks before a start, and the exclusion of vehicles."""

from typing import Annotated

from pydantic import Field

from gcs.api.schemas.rest import Inward, Measured, Outward
from gcs.model.preflight_report import State

REASON_MAX = 200

# In


class ExcludeBody(Inward):
    """Why a vehicle is excluded from the show."""

    reason: Annotated[str, Field(max_length=REASON_MAX, examples=["a propeller is cracked"])] = ""


# Out


class Check(Outward):
    """One check before a start."""

    name: str
    state: State = Field(description="Result of the check; unknown counts as failed.")
    value: Measured = Field(description="The measured value; null: not known, or no number.")
    unit: str
    limit: str = Field(description="Values that pass.")
    problem: str = Field(description="What is wrong; empty when it passes.")
    to_do: str = Field(description="How to correct it.")


class VehicleChecks(Outward):
    """All checks of one vehicle before a start."""

    id: str
    passes: bool
    flies: bool = Field(description="Whether the vehicle takes part in a start when every check passes.")
    reason: str = Field(description="Why it does not fly.")
    checks: list[Check]


class Preflight(Outward):
    """All checks before a start."""

    passes: bool = Field(description="Whether a start would be accepted now.")
    unix_time_s: float = Field(description="Time of the check; in the air: before take-off.")
    show: str | None
    show_hash: str | None
    fleet: list[Check]
    vehicles: list[VehicleChecks]
    not_flying: dict[str, str] = Field(description="Vehicles that would stay on the ground, and why.")
    not_checked: list[str] = Field(description="What is not checked, and why.")
