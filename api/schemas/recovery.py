"""JSON schemas of an interrupted flight."""

from pydantic import BaseModel, ConfigDict, Field

from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import Phase, ShowPhase


class _Outward(BaseModel):
    """As `Outward` of `api.schemas.rest`, which imports this module."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Remaining(_Outward):
    """One vehicle that was airborne, and its state now."""

    before: Phase = Field(description="Phase at the end of the record.")
    pad_known: bool = Field(description="Whether it can be brought home.")
    waits: bool = Field(description="Waits for a command: take-over or bring-home would reach it.")
    text: str


class WrittenShow(_Outward):
    """The written show that was flown, and its position."""

    name: str
    hash: str
    cue: str
    clock_s: float


class InterruptedFlight(_Outward):
    """A flight that was interrupted when the service ended or stalled. An operator must resume or end it."""

    session: str
    unix_time_s: float = Field(description="When the flight was interrupted.")
    cause: str = Field(
        description="What interrupted the flight, in words.", examples=["the service stalled for 4.4 s"]
    )
    show: ShowPhase
    selected: WrittenShow | None
    vehicles: dict[str, Remaining]
    offers: list[Offer] = Field(
        description="Commands that are accepted: POST /api/v1/show/take-over and others."
    )
    problems: list[str] = Field(description="Why the other commands are refused.")
