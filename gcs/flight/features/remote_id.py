"""Remote ID of one station: the operator's place and the swarm's area to all transponders."""

from collections.abc import Callable, Iterator, Sequence
from math import cos, inf, isfinite, nan, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.config.schema import Config
from gcs.flight.state.elsewhere import Elsewhere
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.links.batch_link import Link
from gcs.links.remote_id.messages import Operator, SwarmArea
from gcs.links.remote_id.sender import RemoteIdSender
from gcs.links.remote_id.settings import RemoteIdSettings
from gcs.links.remote_id.transponders import Transponders
from gcs.links.targets.receive import intake_of, keep_receiving
from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.preflight_report import Check, State
from gcs.model.state import Array, FleetState
from gcs.model.target_fix import TargetFix
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import RemoteIdView

FLIES: Final = AIRBORNE | {Phase.PILOT}
SWARM: Final = FLIES | {Phase.LOST, Phase.KILLED}
"""A killed vehicle counts until it was seen on the ground."""

PLACE_OLD_S: Final = 10.0
"""The operator's place counts as lost without a fix for so long."""

AREA_S: Final = 0.2
"""So often the area is computed; each vehicle is sent it at least once a second."""

AHEAD_S: Final = 0.5
"""The area is that of so much later: the middle of the time for which it is the newest one."""

RECENT_S: Final = 1.0
"""So long a reported velocity counts for this."""

DIRECTIONS: Final = 64
"""In which the outermost vehicles are looked for; between two of them 0.12 % are added."""

TEXTS_S: Final = 15.0
TEXTS: Final = ("ODID: lost transmitter", "ODID: lost operator location", "Open Drone ID system")
"""How texts of autopilots begin that say that Remote ID fails in flight."""

CHECK: Final = "remote id"
OPERATOR_CHECK: Final = "operator's place"
LOOK: Final = "look after the transponder, its power and its connection to the autopilot"
RECEIVER: Final = "look after the operator's receiver, or give a fixed place: remote_id.operator"
SHOWN_MAX: Final = 3


def swarm_area(position_m: Array, group_m: Array, grown_m: Array, count: int, ground_m: float) -> SwarmArea:
    """The area of a swarm as each vehicle reports it: from where it is itself.

    Args:
        position_m: (n, 3) of the vehicles that report, show frame; NaN: not known.
        group_m: (g, 3) where vehicles of the swarm are, or may be.
        grown_m: (g,) by which each of these may be off, sideways.
        count: of vehicles.
        ground_m: the origin's height above the ellipsoid.
    """
    located = np.isfinite(group_m).all(axis=1)
    group_m, grown_m = group_m[located], grown_m[located]
    if not len(group_m):
        return SwarmArea(count, np.zeros(len(position_m)), nan, nan)
    outer = _outermost(group_m[:, :2], grown_m)
    apart_m = np.linalg.norm(position_m[:, None, :2] - group_m[None, outer, :2], axis=2) + grown_m[outer]
    radius_m = apart_m.max(axis=1) / (1.0 if len(outer) == len(group_m) else cos(pi / DIRECTIONS))
    widest_m = float(np.nanmax(radius_m)) if np.isfinite(radius_m).any() else float(grown_m.max())
    radius_m = np.where(np.isfinite(radius_m), radius_m, widest_m)
    height_m = ground_m - group_m[:, 2]
    return SwarmArea(count, radius_m, float(np.ceil(height_m.max())), float(np.floor(height_m.min())))


def _outermost(place_m: Array, grown_m: Array) -> NDArray[np.intp]:
    """Of (g, 2) places those that are farthest in some direction; all where they are few."""
    if len(place_m) <= DIRECTIONS:
        return np.arange(len(place_m))
    angle_rad = 2.0 * pi * np.arange(DIRECTIONS) / DIRECTIONS
    along_m = place_m @ np.stack([np.cos(angle_rad), np.sin(angle_rad)]) + grown_m[:, None]
    return np.unique(along_m.argmax(axis=0))


class RemoteId(Feature):
    """Remote ID of one station; without settings nothing is sent. Used on the event loop only."""

    name = "remote_id"

    def __init__(
        self,
        config: Config,
        newest: Newest,
        vehicles: FlightVehicles,
        links: Sequence[Link],
        seen: Callable[[], FleetState],
        closed: Callable[[], tuple[Array, Array]],
        elsewhere: Callable[[], Elsewhere],
        unix_s: Callable[[], float],
        unix_minus_loop_s: Callable[[], float],
    ) -> None:
        """Send nothing yet.

        Args:
            config: with or without a section `remote_id`.
            newest: of the flight.
            vehicles: all of the flight.
            links: those that they are on.
            seen: the state; of silent vehicles what was known last.
            closed: paths that lost vehicles may take, (m, 2, 3), and the uncertainty of each (m,).
            elsewhere: vehicles that other stations fly.
            unix_s: this computer's clock, since 1970.
            unix_minus_loop_s: the same minus the loop's; NaN: it is not to be trusted.
        """
        self.settings: RemoteIdSettings | None = config.remote_id
        self._newest, self._vehicles, self._frame, self._own = (
            newest,
            vehicles,
            config.frame,
            config.own_tracks,
        )
        self._seen, self._closed, self._elsewhere = seen, closed, elsewhere
        self._unix_s, self._unix_minus_loop_s = unix_s, unix_minus_loop_s
        self._row_on = {name: (at, row) for at, link in enumerate(links) for row, name in enumerate(link.ids)}
        self._links = links
        self._rows = [np.array([vehicles[name].row for name in link.ids]) for link in links]
        self._senders, self._transponders = list[RemoteIdSender](), list[Transponders]()
        self._place: tuple[float, float, float, float] = (nan, nan, nan, -inf)  # degrees, m AMSL, of when
        self._problem = "nothing was received yet"
        self._area, self._area_s = SwarmArea(0, np.zeros(len(vehicles)), nan, nan), -inf
        if self.settings is None:
            return
        for link in links:
            rows = {name: row for row, name in enumerate(link.ids)}
            given = {rows[name]: each for name, each in self.settings.basic_ids.items() if name in rows}
            self._senders.append(RemoteIdSender(self.settings, given, link.outbox, link.budget))
            transponders = Transponders(len(link.ids))
            link.listen(transponders.listener)
            self._transponders.append(transponders)
        if self.settings.source is not None:
            self.intakes = (intake_of("operator", self.settings.source, self._own),)

    # the operator

    async def receive(self) -> None:
        if self.settings is not None and self.settings.source is not None:
            own = self.settings.source, self._own
            await keep_receiving(*own, self.take, self.failed, self.intakes[0])

    def take(self, fix: TargetFix) -> None:
        """Take a report of where the operator is."""
        if isfinite(fix.latitude_deg) and isfinite(fix.longitude_deg):
            self._place = (fix.latitude_deg, fix.longitude_deg, fix.altitude_amsl_m, fix.arrived_s)
            self._problem = ""

    def failed(self, why: str) -> None:
        """Note why nothing arrives."""
        self._problem = why

    def _operator(self, now_s: float) -> Operator:
        if self.settings is None:
            return Operator(nan, nan, nan, live=False)
        geoid_m = self.settings.geoid_m
        if (place := self.settings.operator) is not None:
            degrees = place.latitude_deg, place.longitude_deg
            return Operator(*degrees, place.altitude_amsl_m + geoid_m, live=False)
        latitude_deg, longitude_deg, altitude_m, time_s = self._place
        if now_s - time_s > PLACE_OLD_S:
            return Operator(nan, nan, nan, live=True)
        return Operator(latitude_deg, longitude_deg, altitude_m + geoid_m, live=True)

    # what is sent

    def send(self) -> None:
        """Send what is due, within the links' budgets."""
        if self.settings is None:
            return
        now_s = self._newest.state.time_s
        if now_s - self._area_s >= AREA_S - 1e-6:
            self._area, self._area_s = self._swarm(), now_s
        operator = self._operator(now_s)
        unix_s = self._unix_s() if isfinite(self._unix_minus_loop_s()) else nan
        for link, sender, rows in zip(self._links, self._senders, self._rows, strict=True):
            if (reached := link.reached()) is not None:
                sender.send(self._area, rows, operator, unix_s, reached[1], reached[0])

    def _swarm(self) -> SwarmArea:
        """Return where the swarm is in half a second; before a start that is where its vehicles stand."""
        phases, newest = self._vehicles.phases, self._newest.state
        goes_m = AHEAD_S * np.where((newest.age_s <= RECENT_S)[:, None], newest.velocity_m_s, 0.0)
        goes_m = np.nan_to_num(goes_m)
        position_m = self._seen().position_m + goes_m
        flies = np.array([phase in SWARM for phase in phases], np.bool_)
        others = self._elsewhere().airborne_m()
        counted = flies if flies.any() or others else np.isfinite(position_m).all(axis=1)
        paths_m, uncertainty_m = self._closed()
        theirs_m = [(at_m + AHEAD_S * m_s)[None] for at_m, m_s in others.values()]
        group_m = [position_m[counted], paths_m.reshape(-1, 3), *theirs_m]
        grown_m = np.zeros(sum(map(len, group_m)))
        grown_m[int(counted.sum()) :][: 2 * len(uncertainty_m)] = np.repeat(uncertainty_m, 2)
        ground_m = self._frame.altitude_amsl_m + (0.0 if self.settings is None else self.settings.geoid_m)
        count = int(counted.sum()) + len(others)
        return swarm_area(newest.position_m + goes_m, np.concatenate(group_m), grown_m, count, ground_m)

    # what is said of it

    def _problem_of(self, vehicle: Vehicle) -> str:
        link, row = self._row_on[vehicle.id]
        return self._transponders[link].problem(row, self._newest.state.time_s)

    def checks(self, at: Instant) -> Iterator[Check]:
        """Whether it is known where the operator is."""
        if self.settings is None:
            return
        limit = "known, at most 10 s old"
        if self._operator(at.time_s).located:
            yield Check(OPERATOR_CHECK, State.PASS, limit=limit)
        else:
            problem = f"it is not known where the operator is: {self._problem or 'its receiver is silent'}"
            yield Check(OPERATOR_CHECK, State.FAIL, None, "", limit, problem, RECEIVER)

    def vehicle_checks(self, vehicle: Vehicle, at: Instant) -> Iterator[Check]:  # noqa: ARG002
        """Whether the vehicle's transponder is ready."""
        if self.settings is None or not self.settings.require:
            return
        problem = self._problem_of(vehicle)
        state = State.FAIL if problem else State.PASS
        yield Check(CHECK, state, None, "", "its transponder is ready", problem, LOOK if problem else "")

    def conditions(self, at: Instant) -> Iterator[Condition]:
        if self.settings is None:
            return
        if not self._operator(at.time_s).located:
            yield Condition(AlarmCause.OPERATOR_UNKNOWN, self._problem or "its receiver is silent")
        for vehicle in self._vehicles.values():
            if vehicle.phase not in FLIES:
                continue
            problem = self._problem_of(vehicle) if self.settings.require else ""
            if problem := problem or self._text(vehicle, at.time_s):
                yield Condition(AlarmCause.REMOTE_ID, problem, (vehicle.id,))

    def _text(self, vehicle: Vehicle, now_s: float) -> str:
        texts = self._newest.telemetry.texts[vehicle.row]
        own = [each.text for each in texts if now_s - each.time_s <= TEXTS_S and each.text.startswith(TEXTS)]
        return f'"{own[-1]}"' if own else ""

    def view(self, at: Instant) -> RemoteIdView | None:
        if self.settings is None:
            return None
        operator, area = self._operator(at.time_s), self._area
        problems = {name: self._problem_of(vehicle) for name, vehicle in self._vehicles.items()}
        bad = [f"{name}: {problem}" for name, problem in problems.items() if problem]
        more = f"; and {len(bad) - SHOWN_MAX} more" if len(bad) > SHOWN_MAX else ""
        return RemoteIdView(
            operator_id=self.settings.operator_id,
            operator_latitude_deg=operator.latitude_deg,
            operator_longitude_deg=operator.longitude_deg,
            operator_altitude_ellipsoid_m=operator.altitude_ellipsoid_m,
            area_count=float(area.count),
            area_radius_m=float(area.radius_m.max(initial=0.0)),
            area_ceiling_m=area.ceiling_m,
            area_floor_m=area.floor_m,
            ready=float(len(problems) - len(bad)),
            missing="; ".join(bad[:SHOWN_MAX]) + more,
            problem=self._why_late(operator),
            sent=sum(sender.sent for sender in self._senders),
        )

    def _why_late(self, operator: Operator) -> str:
        crowded = [link.name for link, each in zip(self._links, self._senders, strict=True) if each.crowded]
        texts = [] if operator.located else [f"the operator's place is not known: {self._problem}"]
        if crowded:
            texts.append(f"no room for the area each second on {', '.join(crowded)}: it goes every 8 s")
        if not isfinite(self._unix_minus_loop_s()):
            texts.append("this computer's clock is not synchronised: no time is sent")
        return "; ".join(texts)
