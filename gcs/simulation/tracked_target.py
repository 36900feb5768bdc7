"""A target of a scenario that moves by itself, and is estimated from what its receiver reports."""

from collections.abc import Iterator
from dataclasses import fields
from math import nan
from typing import Final

import numpy as np

from gcs.estimation.targets.source_clock import SourceClock
from gcs.estimation.targets.target import TargetEstimate
from gcs.estimation.targets.tracker import TargetReport, Tracker, TrackState
from gcs.formation.following import CenterLimits, inside_circle
from gcs.model.frames import ShowFrame
from gcs.model.plan import Target
from gcs.model.state import Array
from gcs.sim.settings import Origin
from gcs.sim.targets.motions import motion, moved
from gcs.sim.targets.reports import Errors, reports
from gcs.sim.targets.reports import Report as Sent
from gcs.simulation.scenario import TrackedTarget

ORIGIN: Final = Origin()
FRAME: Final = ShowFrame(ORIGIN.latitude_deg, ORIGIN.longitude_deg, ORIGIN.altitude_amsl_m)


class MovingTarget:
    """Truth, reports and estimate of one target: the estimator is that of the flight."""

    def __init__(self, settings: TrackedTarget, seed: int) -> None:
        self._settings = settings
        begins = motion(settings.motion, seed=seed, speed_m_s=settings.speed_m_s)
        self._motion = moved(begins, settings.ahead_m, 0.0)
        names = {field.name for field in fields(Errors)}
        errors = Errors(
            **{name: getattr(settings, name) for name in names & type(settings).model_fields.keys()}
        )
        self._sent: Iterator[Sent] = reports(self._motion, ORIGIN, errors, seed)
        self._next = next(self._sent)
        self._estimate = TargetEstimate([Tracker(settings.noise_m, settings.coast_s, SourceClock(0.0))])

    def truth_m(self, time_s: float) -> Array:
        """(2,) where it is."""
        state = self._motion(time_s)
        return np.array([state.north_m, state.east_m])

    def take(self, now_s: float) -> None:
        """Take what has been sent."""
        while self._next.sent_s <= now_s:
            self._estimate.tracker.take(self.report(self._next), 0.0)
            self._next = next(self._sent)

    def seen(self, now_s: float, was: Target, limits: CenterLimits) -> Target:
        """What the formation follows: where the target is estimated, or where it was when it was lost."""
        self.take(now_s)
        motion = self._estimate.motion(now_s)
        if motion is None:
            return was
        if self._estimate.state(now_s) is TrackState.LOST:
            return was.held(now_s)
        target = motion.target(now_s, self._settings.clearance_m)
        return inside_circle(target, limits) if motion.belief.circles and not target.clearance_m else target

    def report(self, sent: Sent) -> TargetReport:
        degrees = (np.array([sent.latitude_deg]), np.array([sent.longitude_deg]))
        place_m = FRAME.position_m(*degrees, np.array([ORIGIN.altitude_amsl_m]))[0]
        moves_m_s = (sent.north_m_s, sent.east_m_s) if self._settings.velocity else (nan, nan)
        place = (float(place_m[0]), float(place_m[1]))
        return TargetReport(sent.sent_s, place, moves_m_s, sent.deviation_m, source_s=sent.clock_s)
