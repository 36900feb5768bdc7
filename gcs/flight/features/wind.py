"""The wind of one flight: measured of its vehicles, compared with what is allowed and what was entered."""

from collections import deque
from collections.abc import Callable, Iterator
from math import isinf, isnan, nan
from typing import Final

import numpy as np

from gcs.config.schema import Config
from gcs.estimation.wind import EVERY_S, KNOWN_M_S, UNKNOWN_AFTER_S, WindEstimate, WindEstimator
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.lifecycle import Phase
from gcs.model.state import Landed, Mask
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import WindView

VELOCITY_OLD_S: Final = 1.0
BACK_M_S: Final = 0.5
"""So much below a limit an alarm of the wind ends."""

LASTS: Final = 15
"""So many looks, of 3 s, a wind must last to count as the greatest, for the rest of the flight."""

REST_S: Final = 60.0
"""A flight is over when no vehicle has flown for so long; a link that is silent for a moment ends none."""

MORE_M_S: Final = 1.0
"""The wind is surely so much more than was entered before that is contradicted: on the ground it is less."""

NO_ATTITUDES: Final = "no attitudes arrive (streams.attitude_hz)"
NOT_YET: Final = "it is measured for some seconds only"
HOVERS: Final = "the vehicles' drag is not known: fly an orbit, or set wind.drag_per_s"
CONTRADICT: Final = "the vehicles contradict each other"


class WindWatch(Feature):
    """Measures in two steps, in two ticks, after their setpoints. Used on the event loop only."""

    name = "wind"

    def __init__(
        self,
        config: Config,
        newest: Newest,
        vehicles: FlightVehicles,
        limits_m_s: tuple[float, float],
        entered: Callable[[], tuple[float, str]],
    ) -> None:
        """Measure nothing yet.

        Args:
            config: its greatest wind, and the drag where it is given.
            newest: of the flight; what is measured with gusts is noted there for the safety filter.
            vehicles: all of the flight.
            limits_m_s: most wind and most gusts in which vehicles may start; inf: not asked for.
            entered: the wind as it was entered, in m/s, and the token that entered it; NaN: it was not.
        """
        self._newest, self._vehicles, self._entered = newest, vehicles, entered
        self._mean_max_m_s, gust_max_m_s = limits_m_s
        self.allowed_m_s = min(config.control.safety.impact.wind_max_m_s, gust_max_m_s)
        self._estimator = WindEstimator(len(vehicles), config.wind.drag_per_s)
        self._due_s, self._taken = -np.inf, False
        self._landed: tuple[Landed, ...] = ()
        self._airborne = np.zeros(len(vehicles), np.bool_)
        self._over = self._differs = False
        self._flew_s = -np.inf  # when a vehicle flew last
        self.greatest_m_s, self._last_m_s = nan, deque[float](maxlen=LASTS)

    @property
    def estimate(self) -> WindEstimate:
        """The newest."""
        return self._estimator.newest

    def _flies(self) -> Mask:
        """(n,) Vehicles that their motors carry, by what they report."""
        telemetry, now_s = self._newest.telemetry, self._newest.state.time_s
        if telemetry.landed is not self._landed:
            self._landed = telemetry.landed
            self._airborne = np.array([each is Landed.IN_AIR for each in telemetry.landed], np.bool_)
        flies = self._airborne & (now_s - telemetry.position_time_s <= VELOCITY_OLD_S)
        if Phase.KILLED in (phases := self._vehicles.phases):
            flies &= [phase is not Phase.KILLED for phase in phases]
        return flies

    def send(self) -> None:
        """Measure; nothing is sent."""
        now_s, telemetry = self._newest.state.time_s, self._newest.telemetry
        if self._taken:
            self._taken = False
            self._note(self._estimator.look(now_s))
        elif now_s >= self._due_s - 1e-6:
            self._due_s, self._taken = now_s + EVERY_S, True
            age_s, flies = now_s - telemetry.attitude_time_s, self._flies()
            if flies.any():
                if now_s - self._flew_s > REST_S:
                    self.greatest_m_s, self._newest.wind_m_s = nan, 0.0
                    self._last_m_s.clear()
                self._flew_s = now_s
            self._estimator.take(now_s, telemetry.attitude_rad, age_s, telemetry.velocity_ned_m_s, flies)

    @property
    def _fly(self) -> bool:
        """Whether vehicles fly, or did a moment ago: as long as an estimate stays."""
        return self._newest.state.time_s - self._flew_s <= UNKNOWN_AFTER_S

    def _note(self, measured: WindEstimate) -> None:
        if measured.time_s < self._newest.state.time_s:  # an older one: none counted now
            return
        self._last_m_s.append(self._reached_m_s(measured))
        if len(self._last_m_s) == LASTS and (least_m_s := min(self._last_m_s)) > 0.0:
            self.greatest_m_s = float(np.fmax(self.greatest_m_s, least_m_s))
            self._newest.wind_m_s = self.greatest_m_s

    def _reached_m_s(self, measured: WindEstimate) -> float:
        """What the wind reaches with its gusts as it is known, or surely has where it is not."""
        return float(np.fmax(measured.with_gusts_m_s, measured.at_least_m_s))

    def conditions(self, at: Instant) -> Iterator[Condition]:  # noqa: ARG002
        measured = self.estimate
        back_m_s = BACK_M_S if self._over else 0.0
        self._over = self._fly and (
            self._reached_m_s(measured) > self.allowed_m_s - back_m_s
            or measured.at_least_m_s > self._mean_max_m_s - back_m_s
        )
        if self._over:
            yield Condition(AlarmCause.WIND_MEASURED, f"{self._in_words(measured)}, {self._limits}")
        entered_m_s, by = self._entered()
        back_m_s = BACK_M_S if self._differs else 0.0
        self._differs = (
            self._fly
            and measured.is_known
            and measured.at_least_m_s > entered_m_s + MORE_M_S - back_m_s  # False for NaN
        )
        if self._differs:
            because = f"{self._in_words(measured)}, {entered_m_s:g} m/s as {by} entered it"
            yield Condition(AlarmCause.WEATHER_DIFFERS, because)

    @property
    def _limits(self) -> str:
        mean = "" if isinf(self._mean_max_m_s) else f", {self._mean_max_m_s:g} m/s without them"
        return f"allowed {self.allowed_m_s:g} m/s with gusts{mean}"

    @staticmethod
    def _in_words(measured: WindEstimate) -> str:
        if not measured.is_known:
            return f"at least {measured.at_least_m_s:.1f} m/s"
        wind = f"{measured.speed_m_s:.1f} m/s from {round(measured.from_deg) % 360:03d} degrees"
        return f"{wind}, gusts to {measured.with_gusts_m_s:.1f} m/s"

    def _why_unknown(self) -> str:
        measured, now_s = self.estimate, self._newest.state.time_s
        if measured.is_known:
            return ""
        if not self._fly:
            return "no vehicle is in the air"
        if not measured.vehicles:
            arrive = (now_s - self._newest.telemetry.attitude_time_s < VELOCITY_OLD_S).any()
            return NOT_YET if arrive else NO_ATTITUDES
        if measured.deviation_m_s <= KNOWN_M_S:
            return NOT_YET
        return HOVERS if measured.drag_error_m_s > 0.5 * measured.deviation_m_s else CONTRADICT

    def view(self, at: Instant) -> WindView:  # noqa: ARG002
        measured = self.estimate
        return WindView(
            speed_m_s=_shown(measured.speed_m_s if measured.is_known else nan),
            from_deg=_shown(measured.from_deg if measured.is_known else nan),
            deviation_m_s=_shown(measured.deviation_m_s),
            with_gusts_m_s=_shown(measured.with_gusts_m_s),
            at_least_m_s=round(measured.at_least_m_s, 2),
            allowed_m_s=self.allowed_m_s,
            greatest_m_s=_shown(self.greatest_m_s),
            drag_per_s=_shown(measured.drag_per_s),
            vehicles=measured.vehicles,
            why_unknown=self._why_unknown(),
        )


def _shown(value: float) -> float | None:
    return None if isnan(value) else round(float(value), 2)
