"""Vehicles that other stations fly, as further rows of a tick: avoided, and never commanded."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs.control.inputs import Task, Tasks
from gcs.control.memory import Memory
from gcs.model.response import FleetResponse
from gcs.model.state import Array, FleetState, Mask, Traits, VehicleId, freeze

HELD_S: Final = -1.0
"""`Memory.unfollowed_s` of a vehicle that its own station sees held: its slot stays with it."""


@dataclass(frozen=True, slots=True, eq=False)
class Others:
    """k vehicles of other stations at the time of a tick, show frame. Owns its arrays.

    Rows of vehicles that were never received are NaN. The same k vehicles in every tick.
    """

    ids: tuple[VehicleId, ...]
    position_m: Array  # (k, 3) brought forward to the tick
    velocity_m_s: Array  # (k, 3)
    unfiltered_m_s: Array  # (k, 3) what their stations' safety filters were given; NaN: not to be counted on
    filtered_m_s: Array  # (k, 3) what these made of that; NaN alike
    uncertainty_m: Array  # (k,) standard deviation of the position, sideways
    charge: Array  # (k,)
    airborne: Mask  # (k,) in the air, or possibly so
    formed: Mask  # (k,) in formation, and flown by a station that is received
    slot_stays: Mask  # (k,) held or carried: its slot stays with it
    segments_m: Array  # (m, 2, 3) paths that vehicles without control may take
    segments_of: NDArray[np.intp]  # (m,) row of each path's vehicle among these k
    drift: tuple[Array, Array] | None = None  # (k, 3) as in Tasks
    pace: float = 1.0  # share of the orbit's speed with which all of them keep up

    def __post_init__(self) -> None:
        k = len(self.ids)
        freeze(self.position_m, (k, 3), "position_m")
        freeze(self.velocity_m_s, (k, 3), "velocity_m_s")
        freeze(self.unfiltered_m_s, (k, 3), "unfiltered_m_s")
        freeze(self.filtered_m_s, (k, 3), "filtered_m_s")
        freeze(self.uncertainty_m, (k,), "uncertainty_m")
        freeze(self.charge, (k,), "charge")

    def joined(
        self, fleet: FleetState, tasks: Tasks, traits: Traits, memory: Memory
    ) -> tuple[FleetState, Tasks, Traits, Memory]:
        """State, tasks, traits and memory of the n own vehicles and these k, in this order.

        Args:
            fleet: n vehicles.
            tasks: n vehicles; every path of a lost vehicle names its row.
            traits: n vehicles.
            memory: n + k vehicles, of the previous tick.
        """
        n, k = len(fleet.ids), len(self.ids)
        together = FleetState(
            fleet.time_s,
            _all_ids(fleet.ids, self.ids),
            np.concatenate([fleet.position_m, self.position_m]),
            np.concatenate([fleet.velocity_m_s, self.velocity_m_s]),
            np.concatenate([fleet.yaw_rad, np.zeros(k)]),
            np.concatenate([fleet.age_s, np.zeros(k)]),
            np.concatenate([fleet.doubtful, np.zeros(k, np.bool_)]),
        )
        with_theirs = _all_tasks(tasks, self.formed.tobytes(), self.airborne.tobytes())
        if tasks.drift is not None or self.drift is not None:
            with_theirs = replace(with_theirs, drift=self._drift_after(tasks.drift, n))
        if len(self.segments_m):  # before those of vehicles that are silent: they are the last
            lost = len(tasks.segments_m) - tasks.silent_segments
            own_of = np.zeros(0, np.intp) if tasks.segments_of is None else tasks.segments_of
            with_theirs = replace(
                with_theirs,
                segments_m=np.concatenate(
                    [tasks.segments_m[:lost], self.segments_m, tasks.segments_m[lost:]]
                ),
                segments_of=np.concatenate([own_of[:lost], self.segments_of + n, own_of[lost:]]),
            )
        if memory.slots is not None:
            before_s = memory.unfollowed_s
            unfollowed_s = np.zeros(n + k) if before_s is None else before_s
            if self.slot_stays.any() or unfollowed_s[n:].any() or before_s is None:
                unfollowed_s = np.concatenate([unfollowed_s[:n], np.where(self.slot_stays, HELD_S, 0.0)])
                memory = replace(memory, law_state=replace(memory.slots, unfollowed_s=unfollowed_s))
        return (
            together,
            with_theirs,
            Traits(
                _all_charges(traits.charge, self.charge),
                _all_speeds_m_s(traits.speed_max_m_s, self.ids),
                np.concatenate([traits.uncertainty_m, self.uncertainty_m]),
                _response(traits.response, k),
            ),
            memory,
        )

    def velocities(self, own_m_s: Array) -> tuple[Array, Array]:
        """Velocities before the safety filter: `own_m_s` (n, 3), and of these k what is reported.

        Returns: (n + k, 3), and (n + k, 3) what the filters of these k made of it; NaN: not known.
        """
        all_m_s = np.concatenate([own_m_s, self.unfiltered_m_s])
        return all_m_s, np.concatenate([np.full_like(own_m_s, np.nan), self.filtered_m_s])

    def _drift_after(self, own: tuple[Array, Array] | None, count: int) -> tuple[Array, Array] | None:
        """(n + k, 3) positions and velocities, as in Tasks, of `count` own vehicles and of these."""
        if own is None and self.drift is None:
            return None
        first = own or (np.full((count, 3), np.nan), np.full((count, 3), np.nan))
        second = self.drift or (np.full((len(self.ids), 3), np.nan), np.full((len(self.ids), 3), np.nan))
        return np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]])


@lru_cache(maxsize=2)  # the own ones stay the same object while all fly in formation
def _all_tasks(own: Tasks, formed: bytes, airborne: bytes) -> Tasks:
    """Of the own vehicles and of k others, by their masks; without the paths and drift of these."""
    on_sphere, in_the_air = np.frombuffer(formed, np.bool_), np.frombuffer(airborne, np.bool_)
    k, follows = len(on_sphere), own.follows_planned_path
    on_sphere = on_sphere & (own.drawn is None)  # while a drawing leads there is no formation
    task = np.where(on_sphere, Task.ELSEWHERE, Task.NONE).astype(np.int8)
    none = np.zeros(k, np.bool_)
    return replace(
        own,
        task=np.concatenate([own.task, task]),
        goal_m=np.concatenate([own.goal_m, np.full((k, 3), np.nan)]),
        airborne=np.concatenate([own.airborne, in_the_air]),
        descending=np.concatenate([own.descending, none]),
        follows_planned_path=None if follows is None else np.concatenate([follows, none]),
    )


Own = TypeVar("Own")
Theirs = TypeVar("Theirs")


def _kept(join: Callable[[Own, Theirs], Own]) -> Callable[[Own, Theirs], Own]:
    """As `join`, which is called again only with other objects than the last time: these seldom change."""
    newest: list[tuple[Own, Theirs, Own]] = []

    def joined(own: Own, elsewhere: Theirs) -> Own:
        if not newest or own is not newest[0][0] or elsewhere is not newest[0][1]:
            newest[:] = [(own, elsewhere, join(own, elsewhere))]
        return newest[0][2]

    return joined


@_kept
def _all_ids(own: tuple[VehicleId, ...], elsewhere: tuple[VehicleId, ...]) -> tuple[VehicleId, ...]:
    return own + elsewhere


@_kept
def _all_charges(own: Array, elsewhere: Array) -> Array:
    return np.concatenate([own, elsewhere])


@_kept
def _all_speeds_m_s(own_m_s: Array, elsewhere: tuple[VehicleId, ...]) -> Array:
    """For vehicles of others no limit but the fleet's."""
    return np.concatenate([own_m_s, np.full(len(elsewhere), np.inf)])


@lru_cache(maxsize=4)  # the own one stays the same from tick to tick
def _response(own: FleetResponse, count: int) -> FleetResponse:
    """Of the own vehicles and `count` of others, which are taken for such as `control` is set for."""
    return own.joined(FleetResponse.alike(count))
