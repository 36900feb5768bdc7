"""The section `preflight` of a configuration: limits of the checks before a start."""

from itertools import combinations
from math import hypot
from typing import Annotated

from pydantic import Field, model_validator

from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import VehicleId

APART_MIN_M = 0.5
"""Least distance of two start places; nearer ones are the same place, written twice."""

LENGTH_MAX_M = 10_000.0


class StartPlace(Settings):
    """Place of a vehicle before the start, in the show frame: x along the show's heading, y to its right."""

    x_m: Annotated[float, Field(strict=True, ge=-LENGTH_MAX_M, le=LENGTH_MAX_M)]
    y_m: Annotated[float, Field(strict=True, ge=-LENGTH_MAX_M, le=LENGTH_MAX_M)]


class PreflightSettings(Settings):
    """Limits of the checks. The report names every check that a limit switches off."""

    battery_min: Annotated[float, Field(ge=0.1, le=1)] = 0.25  # a show's own need counts if it is higher
    require_fix: bool = True  # False: for vehicles with a position source other than GNSS
    rotation_max_deg: Annotated[float, Field(gt=0, le=45)] = 2.0  # of the start pattern
    shift_max_m: Positive = 2.0  # of the pattern's centre
    place_max_m: Positive = 1.5  # of one vehicle from its own place in the pattern
    height_spread_max_m: Positive = 2.0  # of a pad above or below the median height
    # Recorded: two vehicles on pads 4 m apart came to 2.3 m while their autopilots climbed and held position.
    wander_m: NotNegative = 0.85  # error of position in PX4's own TAKEOFF and HOLD; 0: not checked
    clock_max_s: Positive | None = 2.0  # between the clocks of vehicle and station; None: not checked
    start_places: dict[VehicleId, StartPlace] = Field(default_factory=dict)  # a written show has its own

    @model_validator(mode="after")
    def _check(self) -> "PreflightSettings":
        for (one, here), (other, there) in combinations(self.start_places.items(), 2):
            if hypot(here.x_m - there.x_m, here.y_m - there.y_m) < APART_MIN_M:
                raise ValueError(f"start_places: {one} and {other} have the same place")
        return self
