"""JSON schemas of errors, health, rights and show files."""

from pydantic import Field

from gcs.api.schemas.fleet import Outward
from gcs.model.settings import Measured
from gcs.service.access import Right


class FieldProblem(Outward):
    """One invalid field."""

    field: str = Field(description="Dotted name; `body` for the whole.", examples=["radius_m"])
    value: str | int | float | bool | None = Field(
        description='The value received; text where JSON cannot hold it ("NaN").', examples=[1.0]
    )
    allowed: str = Field(description="What is allowed.", examples=["at least 6.2 m for 12 vehicles"])


class ErrorBody(Outward):
    """The common shape of every error."""

    detail: str = Field(
        description="The error in words, for a person.", examples=["radius_m = 1.0: at least 6.2 m"]
    )
    problems: list[FieldProblem] = Field(
        description="The fields that are wrong, for a program; empty: no field is."
    )


class Health(Outward):
    """Whether the control loop runs and its newest state is fresh."""

    alive: bool
    view_age_s: float = Field(description="Age of the newest state.")
    tick_rate_hz: Measured
    access: str = Field(description="Whether the service demands tokens, in words.", examples=["tokens"])
    emergency_port: int | None = Field(description="Port of the emergency listener; null: there is none.")


class Readiness(Outward):
    """Whether at least one vehicle can be commanded."""

    ready: bool
    vehicles_ready: int = Field(description="Vehicles that could start now.")
    vehicles_airborne: int
    vehicles: int = Field(description="Configured vehicles.")


class Access(Outward):
    """The caller and its rights."""

    name: str = Field(description="The token's name; `local` without any.", examples=["local"])
    rights: list[Right] = Field(description="watch: read; emergency: also pause, land, kill; operate: all.")


class ShowText(Outward):
    """A show file and its text."""

    name: str
    text: str = Field(description="YAML, as it was uploaded.")
