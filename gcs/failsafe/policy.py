"""Failsafes of this service in flight: causes, actions, settings. Pure.

The conditions are in `gcs.failsafe.triggers`; `gcs.flight.monitors.failsafe_monitor` commands what they
request. Decision 0016.
"""

from enum import StrEnum
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, model_validator

from gcs.model.settings import NotNegative, Positive, Settings

Share: TypeAlias = Annotated[float, Field(gt=0, le=1)]


class Cause(StrEnum):
    """Cause of a failsafe."""

    VEHICLE_LOST = "vehicle lost"
    LOW_BATTERY = "low battery"
    CRITICAL_BATTERY = "critical battery"
    BAD_POSITION = "bad position"
    FENCE = "fence ahead"
    WIND = "too much wind"
    LINKS_LATE = "links late"
    VEHICLES_LOST = "too many vehicles lost"
    TARGET_STALE = "target stale"
    SERVICE_LATE = "service late"


class Action(StrEnum):
    """Action of a failsafe, for the vehicles concerned or for the whole show."""

    IGNORE = "ignore"  # does nothing, and shows nothing
    RE_FORM = "re-form"  # the remaining vehicles close the gap
    HOLD_TARGET = "hold-target"  # the target stays where it is now
    HOLD = "hold"  # the vehicle leaves the formation and holds
    PAUSE = "pause"  # all vehicles hold in place
    RETURN = "return"  # return through the filter, and land
    LAND = "land"  # land on a safe site near by, through the filter


SEVERITY: Final = {
    Action.IGNORE: 0,
    Action.RE_FORM: 1,
    Action.HOLD_TARGET: 1,
    Action.HOLD: 2,
    Action.PAUSE: 2,
    Action.RETURN: 3,
    Action.LAND: 4,
}
"""The most severe action prevails, and a weaker one never replaces what is in progress."""

FLIES_ON: Final = 0
"""Severity when no failsafe is in progress."""


class VehicleLost(Settings):
    """A vehicle is silent for `operation.silence_s`. The remaining vehicles always close the gap."""

    action: Literal["re-form", "pause", "return", "land"] = "re-form"


class LowBattery(Settings):
    """A battery is low: its vehicle leaves the formation. The autopilot's own failsafe should act later."""

    action: Literal["ignore", "hold", "return", "land"] = "return"
    below: Share = 0.2
    critical_action: Literal["return", "land"] = "land"
    critical_below: Share = 0.1
    for_s: NotNegative = 2.0

    @model_validator(mode="after")
    def _check(self) -> "LowBattery":
        if not self.critical_below < self.below:
            raise ValueError(f"critical_below = {self.critical_below:g}: less than below = {self.below:g}")
        return self


class BadPosition(Settings):
    """A reported accuracy is too low, or a position jumps repeatedly, or is not plausible."""

    action: Literal["hold", "return", "land"] = "hold"
    then_land_after_s: Positive | None = 10.0  # if that did not help; None: it keeps holding
    horizontal_max_m: Positive = 4.0  # about where preflight refuses it
    vertical_max_m: Positive = 8.0
    for_s: NotNegative = 3.0
    jumps: Annotated[int, Field(ge=1, le=20)] = 3
    jumps_within_s: Positive = 30.0


class FenceAhead(Settings):
    """A vehicle will be outside the fence soon, although the filter steers against it: wind, or a jump."""

    action: Literal["hold", "return", "land"] = "return"
    within_s: Positive = 1.0  # at its present velocity; what the filter allows never gets out within 1 s
    beyond_m: NotNegative = 0.5
    for_s: NotNegative = 0.3


class TooMuchWind(Settings):
    """For some time most vehicles have not followed their commanded velocities."""

    action: Literal["ignore", "pause", "return", "land"] = "pause"
    then_return_after_s: Positive | None = 10.0  # if vehicles cannot hold either; None: it keeps waiting
    speed_error_m_s: Positive = 1.5  # between commanded and actual velocity, sideways
    share: Share = 0.5  # of the vehicles under control
    for_s: NotNegative = 5.0


class LinksLate(Settings):
    """Telemetry of many vehicles arrives late or not at all: they cannot follow setpoints in time."""

    action: Literal["ignore", "pause", "return", "land"] = "pause"
    then_return_after_s: Positive | None = None  # a return over late links is no safer than holding
    late_s: Positive = 0.2  # on average, compared with the soonest that telemetry ever arrived
    arrive_min: Share = 0.5  # of the requested position messages
    share: Share = 0.5  # of the vehicles under control
    for_s: NotNegative = 3.0


class VehiclesLost(Settings):
    """Too many vehicles are lost or killed to continue the show: both numbers must be reached."""

    action: Literal["ignore", "pause", "return", "land"] = "return"
    count: Annotated[int, Field(ge=1)] = 2
    share: Share = 0.25  # of all in the air, the lost included


class TargetStale(Settings):
    """The target of a show's live cue has not been updated."""

    action: Literal["ignore", "hold-target", "pause", "return"] = "hold-target"
    after_s: Positive = 5.0


class ServiceLate(Settings):
    """Ticks come late for some time, on average of about a second."""

    action: Literal["ignore", "pause", "return"] = "pause"
    then_return_after_s: Positive | None = 10.0
    late_s: Positive = 0.05
    for_s: NotNegative = 3.0


class FailsafePolicy(Settings):
    """The settings of every failsafe, and those that all share."""

    vehicle_lost: VehicleLost = VehicleLost()
    low_battery: LowBattery = LowBattery()
    bad_position: BadPosition = BadPosition()
    fence: FenceAhead = FenceAhead()
    wind: TooMuchWind = TooMuchWind()
    links_late: LinksLate = LinksLate()
    vehicles_lost: VehiclesLost = VehiclesLost()
    target_stale: TargetStale = TargetStale()
    service_late: ServiceLate = ServiceLate()
    clear_s: Positive = 5.0  # a cause that has been absent for this time may act again
    together_share: Share = 0.5  # if this share must return, all vehicles return together
