"""The law `slots`: every vehicle flies to a slot of its own, and the slots repel each other.

Slots begin with their vehicles, stay with those that are held, and are moved on between two ticks.
"""

import numpy as np
from numpy.typing import NDArray

from gcs.formation.law import LawSettings, begun, directions_from, slot_velocity, turned
from gcs.formation.laws.protocol import FormationLaw, GoalShape, LawAnswer, LawInputs, SlotsState
from gcs.formation.repulsion import sweep, sweeps_for
from gcs.model.jit import kernel
from gcs.model.state import Array

HELD_S, SLOT_STAYS_S = 1.0, 3.0
"""A vehicle that does not follow for the first time is held; its slot then stays with it for the second."""

SLOW_SHARE, OFF_M = 0.4, 1.5
"""A vehicle does not follow with less than this share of its expected speed, this far from its slot."""

PULL_BESIDE_PATHS = 0.05
"""`LawSettings.pull` while slots would lie in closed space: they come to rest only with their vehicles."""


class Slots(FormationLaw):
    """No slot is assigned: each begins at its vehicle's own direction, and all of them move."""

    settings = LawSettings
    goal_shape = GoalShape.SPHERE
    stations = "led"
    has_slots = True
    turns_alike = True

    def velocity(self, inputs: LawInputs) -> LawAnswer:
        """Each vehicle flies to its own slot; the slots are moved on for the next tick."""
        law = LawSettings.model_validate(inputs.settings)
        direction, distance_m = directions_from(inputs.position_m, inputs.center_m)
        slots = _laid(inputs, direction, law)
        place = inputs.for_fleet(slots.place, np.nan)
        if (
            inputs.led_place is not None and inputs.rows is not None
        ):  # those of others, for the time when this station leads
            place = inputs.led_place.copy()
            place[inputs.rows] = slots.place
        offset_m = distance_m[:, None] * direction - inputs.radius_m * slots.place
        fastest_m_s = inputs.stopping_speed_m_s(np.sqrt((offset_m * offset_m).sum(axis=1)))
        own_m_s = slot_velocity(
            direction,
            distance_m,
            slots.place,
            inputs.radius_m,
            law.slot_rate_per_s,
            np.minimum(law.speed_m_s, fastest_m_s),
        )
        change = inputs.for_fleet(slots.change, 0.0)
        if inputs.led_place is not None:
            return LawAnswer(own_m_s, SlotsState(place, change, slots.unfollowed_s), place=place)

        def move_on() -> SlotsState:
            later, changes = _moved_on(inputs, direction, slots, law)
            return SlotsState(
                inputs.for_fleet(later, np.nan), inputs.for_fleet(changes, 0.0), slots.unfollowed_s
            )

        return LawAnswer(own_m_s, later=move_on, place=place)


def _laid(inputs: LawInputs, direction: Array, law: LawSettings) -> SlotsState:
    """Turn the slots with the formation, begin those of joining vehicles, and keep some with their vehicles.

    Rows of the slots are those of the inputs; `unfollowed_s` has all rows.
    """
    count = len(inputs.fleet_ids) or len(inputs.ids)
    rows = np.arange(count) if inputs.rows is None else inputs.rows
    before = (
        inputs.state if isinstance(inputs.state, SlotsState) else SlotsState.of(np.full((count, 3), np.nan))
    )
    places, changes = inputs.of_fleet(before.place), inputs.of_fleet(before.change)
    if inputs.spin_rad_s:
        places, changes = (turned(each, inputs.spin_rad_s * inputs.dt_s) for each in (places, changes))
    if inputs.led_place is not None:
        led = inputs.of_fleet(inputs.led_place)
        places, changes = np.where(np.isnan(led), places, led), np.zeros_like(changes)
    joining = np.isnan(places[:, 0]).nonzero()[0]
    if len(joining):
        places[joining] = begun(direction[joining], inputs.ids, joining, law)
        changes[joining] = 0.0
    unfollowed_s = np.zeros(count) if before.unfollowed_s is None else before.unfollowed_s.copy()
    _keep_with_vehicles(
        unfollowed_s,
        places,
        changes,
        rows,
        direction,
        inputs.velocity_m_s if inputs.fleet_velocity_m_s is None else inputs.fleet_velocity_m_s,
        np.full((count, 3), np.nan) if inputs.expected_m_s is None else inputs.expected_m_s,
        inputs.center_velocity_m_s,
        inputs.radius_m,
        inputs.dt_s,
    )
    return SlotsState(places, changes, unfollowed_s)


def _moved_on(
    inputs: LawInputs, direction: Array, slots: SlotsState, law: LawSettings
) -> tuple[Array, Array]:
    """(n, 3) slots and changes for the next tick: they repel each other, and leave closed space."""
    charge, closed, sweeps = (
        inputs.charge,
        inputs.closed,
        sweeps_for(len(direction), law.sweeps, inputs.number),
    )
    places, changes = sweep(slots.place, slots.change, direction, charge, sweeps, law.pull)
    if closed is not None and closed.move_out(places):  # again, gently: each sweep leads them back in
        pull, changes = max(law.pull, PULL_BESIDE_PATHS), np.zeros_like(changes)
        places, changes = sweep(slots.place, changes, direction, charge, 1, pull)
        closed.move_out(places)
    return places, changes


@kernel
def _keep_with_vehicles(
    unfollowed_s: Array,
    places: Array,
    changes: Array,
    rows: NDArray[np.intp],
    direction: Array,
    velocity_m_s: Array,
    expected_m_s: Array,
    center_m_s: Array,
    radius_m: float,
    dt_s: float,
) -> None:
    """Update how long each vehicle has not moved as expected, and lay the slots of those held where they are.

    A vehicle that something holds or carries does not come to its slot, so its slot comes to it, and the
    others make room. After `SLOT_STAYS_S` the slot is free again: if the vehicle is, too, it follows.

    Args:
        unfollowed_s: (n,) as in Memory, changed.
        places: (m, 3) slots of the vehicles on the sphere, changed.
        changes: (m, 3) of the slots, changed.
        rows: (m,) of these vehicles.
        direction: (m, 3) to the vehicles.
        velocity_m_s: (n, 3) measured.
        expected_m_s: (own, 3) of the first rows, relative to the centre, NaN: not commanded.
        center_m_s: (3,) velocity of the centre.
        radius_m: of the sphere.
        dt_s: since the previous tick.
    """
    slow = np.zeros(len(unfollowed_s), np.bool_)
    for a in range(len(rows)):
        i, off, along, enough = rows[a], 0.0, 0.0, 0.0
        if i >= len(expected_m_s):
            continue  # another station flies it
        for k in range(3):
            off += (places[a, k] - direction[a, k]) ** 2
            along += (velocity_m_s[i, k] - center_m_s[k]) * expected_m_s[i, k]
            enough += expected_m_s[i, k] ** 2
        slow[i] = radius_m * np.sqrt(off) > OFF_M and along < SLOW_SHARE * enough
    for i in range(len(unfollowed_s)):
        before_s = unfollowed_s[i]
        unfollowed_s[i] = min(before_s + dt_s, 0.0 if before_s < 0.0 else HELD_S)
        if before_s >= 0.0 and not slow[i]:
            unfollowed_s[i] = 0.0
        if unfollowed_s[i] >= HELD_S:
            unfollowed_s[i] = -SLOT_STAYS_S
    for a in range(len(rows)):
        if unfollowed_s[rows[a]] < 0.0:
            places[a], changes[a] = direction[a], 0.0
