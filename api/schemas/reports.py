"""JSON schemas of errors, health, rights, show files and drawings."""

from typing import Literal

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
    vehicles_ready: int = Field(
        description="Vehicles whose autopilots report that they can be armed; whether a start is accepted"
        " says `start_refused` of the show."
    )
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


class DrawingClaims(Outward):
    """What a drawing says that it keeps to; null: it is silent."""

    separation_min_m: float | None
    speed_max_m_s: float | None = Field(description="Sideways.")
    climb_max_m_s: float | None
    sink_max_m_s: float | None
    height_max_m: float | None = Field(description="Above the show's origin.")


class ImportedShow(Outward):
    """A show that was made of a drawing."""

    show: str = Field(description="Name of the stored show.")
    drawing: str = Field(description="Name of its drawing's file.")
    vehicles: int
    duration_s: float = Field(description="Of the drawing.")
    claims: DrawingClaims
    notes: list[str] = Field(description="What of the file is not used.")
    replaced: bool = Field(description="It replaced a show of that name.")


class Placement(Outward):
    """Where a drawn show lies: turned with its pads about the drawing's origin, then moved; show frame."""

    x_m: float
    y_m: float
    turn_deg: float = Field(description="Clockwise seen from above.")


class VehicleAtPad(Outward):
    """A vehicle, and the pad that it stands on or nearest to."""

    id: str
    x_m: Measured = Field(description="Show frame; null: it is not on the ground, or has no position.")
    y_m: Measured
    pad: int | None = Field(description="Index of its pad; null: it has none.")
    off_m: Measured = Field(description="Distance from that pad.")


class PlacedShow(Placement):
    """A drawn show at one placement, and how far the vehicles stand from its pads."""

    show: str
    heading_deg: float = Field(description="Of the drawing's x axis, clockwise from north.")
    stored: Placement = Field(description="As the show file has it, in the service's frame.")
    written: Placement = Field(description="As the show file has it, in the frame of its own origin.")
    origin_changes: bool = Field(
        description="The show file names another origin than the service: to place it replaces that."
    )
    fence_distance_m: float = Field(description="Of the show's fence, with the same room as before.")
    assigned: Literal["nearest", "file"] = Field(
        description="nearest: any vehicle may stand on any pad; file: the fleet's first on the first pad."
    )
    pads_m: list[list[float]] = Field(description="x and y of every pad at this placement.")
    vehicles: list[VehicleAtPad] = Field(description="All vehicles, in the fleet's order.")
    rms_m: Measured = Field(description="Root mean square of the distances; null: no vehicle has a pad.")
    max_m: Measured = Field(description="Greatest distance.")


class DrawnCue(Outward):
    """A cue as it is played."""

    cue: str
    at_s: float = Field(description="On the show's clock.")


class DrawnSamples(Outward):
    """A drawn show at `from_s`, and every `1 / rate_hz` seconds from there."""

    show: str
    vehicles: list[str] = Field(description="Names in the drawing.")
    duration_s: float = Field(description="Of the show.")
    from_s: float
    rate_hz: float = Field(description="As requested, or lower.")
    positions_m: list[list[float]] = Field(
        description="For each time x, y and height of one vehicle after the other; empty: the law leads then."
    )
    colours: list[str] = Field(
        description="For each time rrggbb of one vehicle after the other; empty: the law leads then."
    )
    cues: list[DrawnCue]
