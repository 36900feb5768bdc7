"""What a service's configuration allows a show, and the keys of a show file in which it says so. Pure."""

from collections.abc import Callable, Mapping
from typing import Final

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.impact import ImpactSettings
from gcs.shows.format import Fleet, ShowFence, ShowLimits

HEIGHT_MIN_M: Final = 3.0
"""Least height of a written fence: what is lower is take-off and landing, which are the station's own."""

AT_MOST: Final[Mapping[str, Callable[[ControlSettings], float]]] = {
    "speed_max_m_s": lambda control: control.safety.limits.horizontal_m_s,
    "climb_max_m_s": lambda control: control.safety.limits.up_m_s,
    "sink_max_m_s": lambda control: control.safety.limits.down_m_s,
    "formation_speed_max_m_s": lambda control: control.law.center_speed_max_m_s,
    "formation_climb_max_m_s": lambda control: control.law.climb_max_m_s,
    "formation_acceleration_max_m_s2": lambda control: control.law.center_acceleration_max_m_s2,
    "radius_rate_max_m_s": lambda control: control.radius_rate_m_s,
}
"""Limits of a show that are at most the service's; `separation_min_m` is at least its floor."""


class ServiceRules(Settings):
    """What a show file needs so that the service for which it is written flies it."""

    takeoff_height_m: Positive = Fleet.model_fields["takeoff_height_m"].default
    takeoff_stagger_s: NotNegative = Fleet.model_fields["takeoff_stagger_s"].default
    exchanges_pads: bool = True  # False: vehicles that return by themselves know only the pads that they left
    limits: ShowLimits = ShowLimits()
    fence: ShowFence | None = None  # the service's; None: not known
    areas: tuple[FencedArea, ...] = ()  # of the service's fence, in its show frame
    controlled_ground: FencedArea | None = None  # likewise
    impact: ImpactSettings = ImpactSettings()

    @classmethod
    def of(cls, control: ControlSettings, operation: OperationSettings) -> "ServiceRules":
        usual, safety = ShowLimits(), control.safety
        within = {key: min(getattr(usual, key), of(control)) for key, of in AT_MOST.items()}
        within["separation_min_m"] = max(usual.separation_min_m, safety.floor.horizontal_m)
        return cls(
            takeoff_height_m=operation.takeoff_height_m,
            takeoff_stagger_s=operation.takeoff_stagger_s,
            exchanges_pads=operation.setpoint_loss_action != "return",
            limits=ShowLimits(**within),
            fence=ShowFence(**safety.fence.model_dump(include=set(ShowFence.model_fields))),
            areas=safety.fence.areas,
            controlled_ground=safety.fence.controlled_ground,
            impact=safety.impact,
        )

    @property
    def usual(self) -> ControlSettings:
        """The usual control settings, with the areas of the service's fence."""
        usual = ControlSettings()
        changes = {"areas": self.areas, "controlled_ground": self.controlled_ground}
        fence = usual.safety.fence.model_copy(update=changes)
        safety = usual.safety.model_copy(update={"fence": fence, "impact": self.impact})
        return usual.model_copy(update={"safety": safety})

    @property
    def height_min_m(self) -> float:
        """Least height of a written fence."""
        return HEIGHT_MIN_M if self.fence is None else max(HEIGHT_MIN_M, self.fence.height_min_m)

    def fenced(self, height_max_m: float, distance_max_m: float) -> ShowFence:
        """Return a fence of this height and distance, no wider than the service's."""
        if self.fence is not None:
            height_max_m = min(height_max_m, self.fence.height_max_m)
            distance_max_m = min(distance_max_m, self.fence.distance_max_m)
        return ShowFence(
            height_min_m=self.height_min_m, height_max_m=height_max_m, distance_max_m=distance_max_m
        )
