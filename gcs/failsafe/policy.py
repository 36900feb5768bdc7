"""Failsafes of this service in flight: causes, actions, settings. Pure (docs/decisions/loss.md).

`gcs.failsafe.triggers` requests an action while a cause holds, `gcs.failsafe.arbitration` decides which of
several requests are commanded, and `gcs.flight.monitors.failsafe_monitor` commands them. To add a cause:

1. add a member to `Cause`, and its settings, with the actions it may have, to `FailsafePolicy`;
2. compute its condition in `gcs.failsafe.triggers`: a row of `OF_VEHICLES` or of `OF_THE_SHOW`;
3. supply in `gcs.flight.monitors.failsafe_monitor` what the condition needs of the running flight;
4. add its alarm to `gcs.service.alarms`, and name it in `OF_FAILSAFE` of `gcs.flight.monitors.alarm_monitor`.

CONTRIBUTING.md has each step in full, with the tests.
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
    MANNED_AIRCRAFT = "manned aircraft"
    TARGET_STALE = "target stale"
    SERVICE_LATE = "service late"


class Action(StrEnum):
    """Action of a failsafe, for the vehicles concerned or for the whole show."""

    IGNORE = "ignore"  # does nothing, and shows nothing
    RE_FORM = "re-form"  # the remaining vehicles close the gap
    HOLD_TARGET = "hold-target"  # the target stays where it is now
    HOLD = "hold"  # the vehicle leaves the formation and holds
    PAUSE = "pause"  # all vehicles hold in place
    DESCEND = "descend"  # the formation flies on lower
    RETURN = "return"  # return through the filter, and land
    LAND = "land"  # land on a safe site near by, through the filter


SEVERITY: Final = {
    Action.IGNORE: 0,
    Action.RE_FORM: 1,
    Action.HOLD_TARGET: 1,
    Action.HOLD: 2,
    Action.PAUSE: 2,
    Action.DESCEND: 3,
    Action.RETURN: 4,
    Action.LAND: 5,
}
"""The most severe action prevails, and a weaker one never replaces what is in progress."""

FLIES_ON: Final = 0
"""Severity when no failsafe is in progress."""


class VehicleLost(Settings):
    """A vehicle is silent for `operation.silence_s`. The remaining vehicles always close the gap."""

    action: Literal["re-form", "pause", "return", "land"] = "re-form"
    """What the others do; they close the gap in any case."""


class LowBattery(Settings):
    """A battery is low: its vehicle leaves the formation. The autopilot's own failsafe should act later."""

    action: Literal["ignore", "hold", "return", "land"] = "return"
    """What a vehicle with a low battery does."""
    below: Share = 0.2
    """Charge below which a battery is low, as a share."""
    critical_action: Literal["return", "land"] = "land"
    """What a vehicle with a critical battery does."""
    critical_below: Share = 0.1
    """Charge below which it is critical, as a share."""
    for_s: NotNegative = 2.0
    """For so long the charge must be below, in s."""

    @model_validator(mode="after")
    def _check(self) -> "LowBattery":
        if not self.critical_below < self.below:
            raise ValueError(f"critical_below = {self.critical_below:g}: less than below = {self.below:g}")
        return self


class BadPosition(Settings):
    """A reported accuracy is too low, or a position jumps repeatedly, or is not plausible."""

    action: Literal["hold", "return", "land"] = "hold"
    """What the vehicle does."""
    then_land_after_s: Positive | None = 10.0
    """It lands if that did not help for so long, in s; null: it keeps holding."""
    horizontal_max_m: Positive = 4.0
    """Worst reported accuracy sideways, in m; preflight refuses about the same."""
    vertical_max_m: Positive = 8.0
    """Worst reported accuracy up and down, in m."""
    for_s: NotNegative = 3.0
    """For so long the accuracy must be worse, in s."""
    jumps: Annotated[int, Field(ge=1, le=20)] = 3
    """So many jumps of the position count as bad."""
    jumps_within_s: Positive = 30.0
    """The time within which `jumps` count, in s."""


class FenceAhead(Settings):
    """A vehicle will be outside the fence soon, although the filter steers against it: wind, or a jump."""

    action: Literal["hold", "return", "land"] = "return"
    """What the vehicle does."""
    within_s: Positive = 1.0
    """How far ahead its present velocity is followed, in s; the filter allows none that gets out in 1 s."""
    beyond_m: NotNegative = 0.5
    """So far outside the fence it would be, in m."""
    for_s: NotNegative = 0.3
    """For so long the condition must hold before it counts, in s."""


class TooMuchWind(Settings):
    """For some time most vehicles have not followed their commanded velocities."""

    action: Literal["ignore", "pause", "return", "land"] = "pause"
    """What the show does."""
    then_return_after_s: Positive | None = 10.0
    """It comes home if a pause did not help for so long, in s; null: it keeps waiting."""
    speed_error_m_s: Positive = 1.5
    """Least difference between commanded and actual velocity, sideways, in m/s."""
    share: Share = 0.5
    """Share of the vehicles under control that must be off by so much."""
    for_s: NotNegative = 5.0
    """For so long the condition must hold before it counts, in s."""


class LinksLate(Settings):
    """Telemetry of many vehicles arrives late or not at all: they cannot follow setpoints in time."""

    action: Literal["ignore", "pause", "return", "land"] = "pause"
    """What the show does."""
    then_return_after_s: Positive | None = None
    """It comes home after so long, in s; null: it waits, a return over late links is no safer."""
    late_s: Positive = 0.2
    """Telemetry is late beyond this, averaged, over the soonest that it ever arrived, in s."""
    arrive_min: Share = 0.5
    """Least share of the requested position messages that must arrive."""
    share: Share = 0.5
    """Share of the vehicles under control with such a link."""
    for_s: NotNegative = 3.0
    """For so long the condition must hold before it counts, in s."""


class VehiclesLost(Settings):
    """Too many vehicles are lost or killed to continue the show: both numbers must be reached."""

    action: Literal["ignore", "pause", "return", "land"] = "return"
    """What the show does when both numbers are reached."""
    count: Annotated[int, Field(ge=1)] = 2
    """Least number of vehicles that are lost or killed."""
    share: Share = 0.25
    """Least share of all in the air, the lost included."""


class MannedAircraft(Settings):
    """A manned aircraft is within `traffic.manned` of the formation: vehicles give way to it."""

    action: Literal["ignore", "descend", "pause", "return", "land"] = "descend"
    """What the show does. A written show does not `descend`: it comes home; a paused one stays paused."""
    to_height_m: Positive = 15.0
    """Height above the origin to which the centre descends, in m, or as low as the fence lets the sphere."""


class TargetStale(Settings):
    """The target of a show's live cue has not been updated, or the selected target is not received.

    A selected target is followed on its last motion, and then held (`coast_s`), whatever is set here.
    """

    action: Literal["ignore", "hold-target", "pause", "return"] = "hold-target"
    """What the show does."""
    after_s: Positive = 5.0
    """Time since the last update, in s."""


class ServiceLate(Settings):
    """Ticks come late for some time, on average of about a second."""

    action: Literal["ignore", "pause", "return"] = "pause"
    """What the show does."""
    then_return_after_s: Positive | None = 10.0
    """It comes home if a pause did not help for so long, in s; null: it keeps waiting."""
    late_s: Positive = 0.05
    """Ticks are late beyond this, averaged over about a second, in s."""
    for_s: NotNegative = 3.0
    """For so long the condition must hold before it counts, in s."""


class FailsafePolicy(Settings):
    """The settings of every failsafe, and those that all share."""

    vehicle_lost: VehicleLost = VehicleLost()
    """A vehicle in the air is not received."""
    low_battery: LowBattery = LowBattery()
    """A battery is low, or critical."""
    bad_position: BadPosition = BadPosition()
    """A position is inaccurate, jumps, or is not plausible."""
    fence: FenceAhead = FenceAhead()
    """A vehicle is about to leave the fence."""
    wind: TooMuchWind = TooMuchWind()
    """Most vehicles do not follow their setpoints."""
    links_late: LinksLate = LinksLate()
    """Telemetry of many vehicles is late, or lacking."""
    vehicles_lost: VehiclesLost = VehiclesLost()
    """Too many vehicles are lost to continue the show."""
    manned_aircraft: MannedAircraft = MannedAircraft()
    """A manned aircraft is near."""
    target_stale: TargetStale = TargetStale()
    """The target of a live cue is not renewed."""
    service_late: ServiceLate = ServiceLate()
    """Ticks come late."""
    clear_s: Positive = 5.0
    """A cause that was absent for this time may act again, in s."""
    together_share: Share = 0.5
    """If this share of those in the air must return, all vehicles return together."""
