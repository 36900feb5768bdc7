"""The site as displays have it: its areas in both frames, and which version of it is stored."""

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from gcs.model.settings import PUBLISHED

SiteFormat: TypeAlias = Literal["geojson", "kml", "plan"]
"""Formats of the file of a site."""

SiteAreaKind: TypeAlias = Literal["flight-geography", "contingency", "ground-risk", "audience", "no-fly"]
"""As `gcs.areas.site.AreaKind`."""


@dataclass(frozen=True, slots=True)
class SiteCorner:
    """A corner on the globe and in the show frame."""

    __pydantic_config__ = PUBLISHED

    latitude_deg: float
    longitude_deg: float
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class SiteAreaView:
    """One area of a site."""

    __pydantic_config__ = PUBLISHED

    kind: SiteAreaKind
    name: str
    corners: Annotated[tuple[SiteCorner, ...], Field(description="Counterclockwise, each once.")]
    height_min_m: Annotated[float, Field(description="Above the origin of the show frame.")]
    height_max_m: Annotated[float | None, Field(description="The same; null: without a limit.")]


@dataclass(frozen=True, slots=True)
class SiteView:
    """The site as its file has it now."""

    __pydantic_config__ = PUBLISHED

    name: str
    file: Annotated[str, Field(description="Name of its file.", examples=["lakeside.geojson"])]
    hash: Annotated[str, Field(description="SHA-256 of its kinds, corners and heights.")]
    version: Annotated[str, Field(description="SHA-256 of the file: what a change of it was made from.")]
    in_force: Annotated[str, Field(description="`hash` of the site that this service flies.")]
    pending: Annotated[str, Field(description="Why no start is possible with it; empty: it is in force.")]
    areas: tuple[SiteAreaView, ...]
