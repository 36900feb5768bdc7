"""Vehicles that come down and get neither lower nor nearer to their places: they land where they are.

Wind carries them off, something is in their way, or a maneuver waits for what does not come. Each is named;
its autopilot lands it where it is, once nothing is below that the flight knows of, or in the end in any case:
where it is carried off, or its battery is low.
"""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.flight.commands.commander import Commander
from gcs.flight.maneuvers.maneuver_steps import Maneuver
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.monitors.space_below import SpaceBelow
from gcs.flight.state.flight import Flight
from gcs.flight.state.headway import LED_M_S, LED_SHARE, Headway
from gcs.flight.state.vehicle import Vehicle
from gcs.model.lifecycle import Phase
from gcs.model.state import Array
from gcs.service.alarms import AlarmCause, AlarmSeverity, Condition

log = logging.getLogger(__name__)

PERIOD_S: Final = 0.2

NOT_LOWER_S: Final = 20.0
"""The slowest descent, of a vehicle that may meet the ground, is 8 m in this time."""

WAITS_S: Final = {Phase.LANDING: 40.0, Phase.RETURN: 160.0}
"""So long a vehicle waits at most for what is below it: one that comes home may be made to land sooner."""

WAY_OPENS_S: Final = 120.0
"""So long a sound vehicle that holds its place on the way home waits for its way: boxes pass, doors open."""

CLEAR_S: Final = 2.0
"""So long nothing may have been below: gusts turn the drift that a look takes, also past what is there."""

AT_PLACE_M: Final = 2.0
"""Nearer than this to its place, a text does not say how far it is from that."""

NAMED_MAX: Final = 3

COMPASS: Final = (
    "north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Landed:
    """A vehicle that lands where it is."""

    task: object
    because: str
    consequence: str
    severity: AlarmSeverity | None


class InPlaceLandings:
    """Of one flight, on the event loop only."""

    def __init__(self, flight: Flight, maneuvers: Maneuvers, commander: Commander) -> None:
        self._flight, self._maneuvers, self._commander = flight, maneuvers, commander
        self._below = SpaceBelow(flight)
        self._headway = Headway(flight.newest, flight.vehicles, self._waits, maneuvers.task, self._place_m)
        self._waiting: dict[Vehicle, str] = {}
        self._met: dict[Vehicle, tuple[float, str]] = {}  # when something was below last, and what
        self._landed: dict[Vehicle, _Landed] = {}
        self._due_s = -np.inf

    def _waits(self, vehicle: Vehicle) -> bool:
        """Whether it waits on purpose at its goal: for lower ones, or in a return that is planned for all."""
        if vehicle.phase is Phase.LANDING:
            return not vehicle.flags.handed_over and not self._flight.may_descend(vehicle)
        together = self._commander.collective_return
        return together is not None and together.leads(vehicle)

    def _place_m(self, vehicle: Vehicle) -> Array | None:
        """(3,) Where it is led in the end: against wind it falls behind a plan's goal, and gets nearer."""
        together = self._commander.collective_return
        if together is None or vehicle.phase is not Phase.RETURN or not together.leads_home(vehicle):
            return vehicle.goal_m
        return together.place_m(vehicle)

    def look(self) -> None:
        """Land those that make no headway; called once a tick."""
        now_s = self._flight.newest.state.time_s
        if now_s < self._due_s:
            return
        self._due_s = now_s + PERIOD_S
        self._headway.look()
        self._waiting.clear()
        self._landed = {
            vehicle: landed
            for vehicle, landed in self._landed.items()
            if vehicle.phase in {Phase.LANDING, Phase.RETURN} and self._maneuvers.task(vehicle) is landed.task
        }
        stands_s = self._headway.stands_s
        self._met = {vehicle: met for vehicle, met in self._met.items() if now_s - met[0] <= CLEAR_S}
        for row in np.flatnonzero(stands_s >= NOT_LOWER_S - CLEAR_S).tolist():
            vehicle = self._flight.vehicles.rows[row]
            if not vehicle.flags.handed_over and not self._maneuvers.touches_down(vehicle):
                self._decide(vehicle, float(stands_s[row]))

    def _decide(self, vehicle: Vehicle, stands_s: float) -> None:
        """Land a vehicle where it is, or note what it waits for; before `NOT_LOWER_S` only what is below."""
        sound = self._is_sound(vehicle)
        if sound and vehicle.phase is Phase.RETURN and NOT_LOWER_S <= stands_s < WAY_OPENS_S:
            in_s = f"in {WAY_OPENS_S - stands_s:.0f} s if it stays closed"
            self._waiting[vehicle] = f"{vehicle.id} waits for its way home, and lands where it is {in_s}."
            return
        drift_m_s = self._drift_m_s(vehicle)
        below = self._below.of(vehicle, drift_m_s)
        if below.in_the_way:
            self._met[vehicle] = self._flight.newest.state.time_s, _named(below.in_the_way)
        _, names = self._met.get(vehicle, (-np.inf, ""))
        if stands_s < NOT_LOWER_S:
            return
        latest = self._latest(NOT_LOWER_S + WAITS_S[vehicle.phase] - stands_s, sound=sound)
        if names and latest:
            self._waiting[vehicle] = f"{vehicle.id} waits for {names} below, and lands where it is {latest}."
            return
        drifts_m_s = float(np.hypot(*drift_m_s))
        why = f"carried off at {drifts_m_s:.0f} m/s" if drifts_m_s >= LED_M_S else "something is in the way"
        because = f"no lower and no nearer to a place for {stands_s:.0f} s, {why}"
        where = self._in_words(vehicle, below.end_m)
        hits = f" It may hit {_named(below.hits)}." if below.hits else ""
        waited = f" It waits no longer for {names} below." if names else ""
        severity = AlarmSeverity.EMERGENCY if hits or waited else None
        self._maneuvers.instead(vehicle, _in_place(self._maneuvers, because))
        self._headway.begin(vehicle)
        follows = f"{vehicle.id} comes down {where}.{waited}{hits}"
        self._landed[vehicle] = _Landed(self._maneuvers.task(vehicle), because, follows, severity)
        reported = {"vehicle": vehicle.id, "reason": because, "place": where}
        log.warning("lands_in_place", extra={**reported, "waited": waited, "hits": hits})

    def _is_sound(self, vehicle: Vehicle) -> bool:
        """Whether it can wait in the air: nothing carries it off, and its battery is not low."""
        below = self._flight.config.failsafes.low_battery.below
        charged = float(self._flight.newest.telemetry.battery_remaining[vehicle.row]) > below  # False for NaN
        return charged and self._headway.holds(vehicle)

    def _latest(self, left_s: float, *, sound: bool) -> str:
        """When it lands onto what is below; empty: now. One that can wait in the air hits nothing."""
        if sound:
            below = self._flight.config.failsafes.low_battery.below
            return f"once nothing is, or its battery is below {below:.0%}"
        return f"in {left_s:.0f} s at the latest" if left_s > 0.0 else ""

    def _drift_m_s(self, vehicle: Vehicle) -> Array:
        """(2,) What it does over the ground although it is not led so; zero where it does as it is led."""
        newest, row = self._flight.newest, vehicle.row
        flown_m_s, asked_m_s = newest.state.velocity_m_s[row, :2], newest.memory.asked_m_s[row, :2]
        if not np.isfinite(flown_m_s).all():
            return np.zeros(2)
        led = float(asked_m_s @ flown_m_s) >= LED_SHARE * float(asked_m_s @ asked_m_s)  # False for NaN
        return np.zeros(2) if led and float(np.hypot(*asked_m_s)) >= LED_M_S else np.array(flown_m_s)

    def _in_words(self, vehicle: Vehicle, end_m: Array) -> str:
        """Where (3,) is, from the vehicle's pad, and on the globe."""
        if not np.isfinite(end_m).all():
            return "where it is, which is not known"
        frame, home_m = self._flight.config.frame, vehicle.home_m
        (latitude_deg,), (longitude_deg,), _ = frame.geodetic(end_m[None])
        place = f"at {latitude_deg:.5f}, {longitude_deg:.5f}"
        if home_m is None:
            return place
        ((north_m, east_m, _),) = frame.into_ned((end_m - home_m)[None])
        turn = int(np.round(np.degrees(np.arctan2(east_m, north_m)) / 45.0)) % 8
        return f"about {np.hypot(north_m, east_m):.0f} m {COMPASS[turn]} of its pad, {place}"

    def conditions(self) -> Iterator[Condition]:
        """Yield vehicles that have made no headway for long, and those that land where they are."""
        stands_s = self._headway.stands_s
        for row in np.flatnonzero(stands_s >= NOT_LOWER_S).tolist():
            vehicle = self._flight.vehicles.rows[row]
            height_m, off_m = (
                -float(self._flight.newest.state.position_m[row, 2]),
                float(self._headway.off_m[row]),
            )
            if not np.isfinite(height_m):
                continue  # it is alarmed of as one without a position
            away = f" and {off_m:.0f} m from [its|their] place" if off_m > AT_PLACE_M else ""
            nor = " and no nearer" if away else ""
            because = f"{height_m:.0f} m high{away}, and no lower{nor} for {float(stands_s[row]):.0f} s"
            refused = self._maneuvers.refused(vehicle)
            follows = f"The autopilot of {vehicle.id} refuses to land it: {refused}." if refused else ""
            yield Condition(AlarmCause.NOT_LOWER, because, (vehicle.id,), self._waiting.get(vehicle, follows))
        for vehicle, landed in self._landed.items():
            yield Condition(
                AlarmCause.LANDS_IN_PLACE,
                landed.because,
                (vehicle.id,),
                landed.consequence,
                severity=landed.severity,
            )


def _in_place(maneuvers: Maneuvers, because: str) -> Maneuver:
    async def maneuver(vehicle: Vehicle) -> None:
        await maneuvers.land_in_place(vehicle, f"its autopilot lands it where it is: {because}")

    return maneuver


def _named(names: tuple[str, ...]) -> str:
    """The first of these in words, and how many more there are."""
    shown = ", ".join(names[:NAMED_MAX])
    return shown if len(names) <= NAMED_MAX else f"{shown} and {len(names) - NAMED_MAX} more"
