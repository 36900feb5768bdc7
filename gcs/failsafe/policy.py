"""What the service does by itself when something goes wrong in the air: causes, actions, settings. Pure.

The rules are in `gcs.failsafe.triggers`; `gcs.flight.failsafe_monitor` orders what they want. Decision 0016.
"""

from enum import StrEnum
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, model_validator

from gcs.model.settings import NotNegative, Positive, Settings

Share: TypeAlias = Annotated[float, Field(gt=0, le=1)]


class Cause(StrEnum):
    """What a reaction answers."""

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
    """What is done: with the vehicles concerned, or with the whole show."""

    IGNORE = "ignore"  # nothing, and nothing is shown
    RE_FORM = "re-form"  # the others close the gap
    HOLD_TARGET = "hold-target"  # the target stays where it is now
    HOLD = "hold"  # the vehicle leaves the formation and holds
    PAUSE = "pause"  # everybody holds in place
    RETURN = "return"  # home, through the filter, and down
    LAND = "land"  # down where it is safe near by, through the filter


SEVERITY: Final = {
    Action.IGNORE: 0,
    Action.RE_FORM: 1,
    Action.HOLD_TARGET: 1,
    Action.HOLD: 2,
    Action.PAUSE: 2,
    Action.RETURN: 3,
    Action.LAND: 4,
}
"""The most severe wins, and nothing that goes on is replaced by something weaker."""

FLIES_ON: Final = 0
"""Severity of what goes on where nothing does."""


class VehicleLost(Settings):
    """Somebody is silent: `operation.silence_s` says for how long. The others always close the gap."""

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
    """A receiver reports too little accuracy, or the position jumps again and again, or is not believed."""

    action: Literal["hold", "return", "land"] = "hold"
    then_land_after_s: Positive | None = 10.0  # where that did not help; None: it holds on
    horizontal_max_m: Positive = 4.0  # about where preflight refuses it
    vertical_max_m: Positive = 8.0
    for_s: NotNegative = 3.0
    jumps: Annotated[int, Field(ge=1, le=20)] = 3
    jumps_within_s: Positive = 30.0


class FenceAhead(Settings):
    """A vehicle will be outside the fence soon, although the filter steers against it: wind, or a jump."""

    action: Literal["hold", "return", "land"] = "return"
    within_s: Positive = 1.0  # with its velocity now; what the filter allows never gets out within 1 s
    beyond_m: NotNegative = 0.5
    for_s: NotNegative = 0.3


class TooMuchWind(Settings):
    """For a while most vehicles have flown otherwise than they were told."""

    action: Literal["ignore", "pause", "return", "land"] = "pause"
    then_return_after_s: Positive | None = 10.0  # where nobody can stand either; None: it waits on
    speed_error_m_s: Positive = 1.5  # between what was wanted and what is flown, sideways
    share: Share = 0.5  # of those under control
    for_s: NotNegative = 5.0


class LinksLate(Settings):
    """Telemetry of many vehicles arrives late or not at all: they cannot follow setpoints in time."""

    action: Literal["ignore", "pause", "return", "land"] = "pause"
    then_return_after_s: Positive | None = None  # a way home over late links is no safer than standing
    late_s: Positive = 0.2  # on average, compared with the soonest that telemetry ever arrived
    arrive_min: Share = 0.5  # of the positions asked for
    share: Share = 0.5  # of those under control
    for_s: NotNegative = 3.0


class VehiclesLost(Settings):
    """So many are lost, or killed, that the show is none any more: both numbers must be reached."""

    action: Literal["ignore", "pause", "return", "land"] = "return"
    count: Annotated[int, Field(ge=1)] = 2
    share: Share = 0.25  # of all in the air, the lost included


class TargetStale(Settings):
    """Nobody has renewed the target of a show's live cue."""

    action: Literal["ignore", "hold-target", "pause", "return"] = "hold-target"
    after_s: Positive = 5.0


class ServiceLate(Settings):
    """Ticks come late, on average of about a second, for a while."""

    action: Literal["ignore", "pause", "return"] = "pause"
    then_return_after_s: Positive | None = 10.0
    late_s: Positive = 0.05
    for_s: NotNegative = 3.0


class FailsafePolicy(Settings):
    """Every reaction, and what they share."""

    vehicle_lost: VehicleLost = VehicleLost()
    low_battery: LowBattery = LowBattery()
    bad_position: BadPosition = BadPosition()
    fence: FenceAhead = FenceAhead()
    wind: TooMuchWind = TooMuchWind()
    links_late: LinksLate = LinksLate()
    vehicles_lost: VehiclesLost = VehiclesLost()
    target_stale: TargetStale = TargetStale()
    service_late: ServiceLate = ServiceLate()
    clear_s: Positive = 5.0  # a cause that has been gone for so long may act again
    together_share: Share = 0.5  # when so many have to come home, everybody does, together
