"""One report of where a target is, as its source gives it."""

from dataclasses import dataclass
from math import nan
from typing import Literal

from gcs.model.traffic import TrackKind


@dataclass(frozen=True, slots=True)
class TargetFix:
    """A report of one target. NaN where its source does not say; WGS84, and velocities along NED.

    A source's own clock may begin anywhere and be wrong; the estimator finds its offset.
    """

    arrived_s: float  # loop clock
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float = nan
    north_m_s: float = nan
    east_m_s: float = nan
    down_m_s: float = nan
    deviation_m: float = nan  # standard deviation along each axis, sideways
    height_deviation_m: float = nan
    velocity_deviation_m_s: float = nan
    source_s: float = nan  # when it was there, by the source's own clock
    track: str = ""  # which one, of a source that has several
    kind: TrackKind | Literal[""] = ""  # what that is, where its source says
    pressure_altitude_m: float = nan  # of an aircraft, instead of the other altitude
