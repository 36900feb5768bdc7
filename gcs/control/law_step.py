"""The law's part of a tick: what it is given, and the vehicles' velocities from its answer."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from gcs.control.center import Lead
from gcs.control.inputs import FormationState, TickInputs
from gcs.control.memory import Memory
from gcs.control.slot_space import LostSpace
from gcs.formation.article import no_faster
from gcs.formation.law import directions_from, goal_velocity, ramped_spin, spin_velocity
from gcs.formation.laws.protocol import FormationLaw, LawAnswer, LawInputs, SlotsState, waits
from gcs.formation.laws.registry import law_of
from gcs.formation.neighbours import Sight
from gcs.formation.orbit import Center
from gcs.formation.response import shrink_relative
from gcs.model.state import Array

LawRunner: TypeAlias = Callable[[LawInputs], LawAnswer]
"""Computes the law of the plan somewhere else than within the tick."""


STOPS_WITHIN_S = 0.5
"""A vehicle that is to hold stops where its velocity takes it within this time."""


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """Where vehicles hold while the law is not relied on; kept in its place in Memory."""

    place_m: Array  # (all, 3), NaN outside the formation

    @staticmethod
    def of(now: TickInputs, before: object) -> "Held":
        """The places of before, and of the vehicles without one those where they stop."""
        stop_m = now.position_m + STOPS_WITHIN_S * now.velocity_m_s
        place_m = before.place_m if isinstance(before, Held) else np.full_like(stop_m, np.nan)
        place_m = np.where(np.isnan(place_m), stop_m, place_m)
        return Held(now.for_sphere(place_m[now.sphere], np.nan))

    def velocity_m_s(self, now: TickInputs) -> Array:
        """(m, 3) to these places."""
        here_m, there_m = now.of_formed(now.position_m), now.of_formed(self.place_m)
        fastest_m_s = now.approach_max_m_s(now.rows, np.linalg.norm(there_m - here_m, axis=1))
        return goal_velocity(
            here_m,
            there_m,
            settings=now.settings.law,
            limits_m_s=now.settings.safety.limits.each_m_s,
            speed_max_m_s=fastest_m_s,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Velocities of the vehicles in formation, and what the law keeps for its next tick."""

    velocity_m_s: Array  # (m, 3) of the m vehicles in formation
    answer: LawAnswer
    spin_rad_s: float = 0.0  # as in Memory
    led_m_s: Array | None = None  # as in Memory


def spread(
    now: TickInputs,
    lead: Lead,
    memory: Memory,
    sight: Sight | None = None,
    shared: FormationState | None = None,
    runner: LawRunner | None = None,
) -> Spread:
    """Velocities of the vehicles in formation by the law that the plan names.

    With `sight` the vehicles compute the law themselves, from the messages they received. `shared` is what
    another station computes for the whole formation. `runner` computes the law; None: it runs here.
    """
    center, law = lead.center, law_of(now.plan.formation.law)
    if center is None or len(now.sphere) == 0:
        state = None if shared is None else SlotsState.of(shared.place)
        return Spread(np.zeros((len(now.rows), 3)), LawAnswer(np.zeros((0, 3)), state))
    spin_rad_s = ramped_spin(
        memory.spin_rad_s,
        now.plan.formation.spin_rad_s,
        lead.radius_m,
        now.dt_s,
        now.settings.law.spin_acceleration_max_m_s2,
    )
    if shared is not None:
        spin_rad_s = shared.spin_rad_s
    inputs = _inputs(now, lead, center, memory, law, spin_rad_s)
    if shared is not None and law.stations == "led":
        inputs = replace(inputs, led_place=shared.place)
    if law.takes_sight:
        inputs = replace(inputs, sight=sight)
    answer, led_m_s = _answered(now, inputs, law, shared, runner)
    if answer.holds:
        held = Held.of(now, memory.law_state)
        return Spread(held.velocity_m_s(now), LawAnswer(answer.velocity_m_s, held), spin_rad_s, led_m_s)
    own_m_s = now.ours(answer.velocity_m_s)
    if spin_rad_s and not law.adds_spin:
        direction, distance_m = directions_from(inputs.position_m, center.position_m)
        offset_m = now.ours(distance_m[:, None] * direction)
        late_s = now.settings.response_s + 2.0 * now.settings.safety.link_delay_s
        own_m_s = own_m_s + spin_velocity(offset_m, spin_rad_s, late_s)
    limits = now.settings.safety.limits
    flown_m_s = shrink_relative(
        center.velocity_m_s,
        own_m_s,
        limits.horizontal_m_s,
        limits.up_m_s,
        limits.down_m_s,
        now.of_formed(now.traits.speed_max_m_s),
    )
    return Spread(flown_m_s, answer, spin_rad_s, led_m_s)


def _answered(
    now: TickInputs,
    inputs: LawInputs,
    law: FormationLaw,
    shared: FormationState | None,
    runner: LawRunner | None,
) -> tuple[LawAnswer, Array | None]:
    """The law's answer, and `led_m_s` as in Memory; at a follower of a `led` law what the lead sent."""
    for_all = law.stations == "led" and not law.has_slots
    if for_all and shared is not None:
        led_m_s = None if shared.led_m_s is None else now.of_sphere(shared.led_m_s)
        if led_m_s is None or np.isnan(led_m_s).all():
            return waits(len(inputs.ids)), None
        return LawAnswer(no_faster(np.nan_to_num(led_m_s), inputs.own_speed_max_m_s)), None
    answer = law.velocity(inputs) if runner is None else runner(inputs)
    if not for_all:
        return answer, None
    all_m_s = np.full_like(answer.velocity_m_s, np.nan) if answer.holds else answer.velocity_m_s
    return answer, now.for_sphere(all_m_s, np.nan)


def _inputs(
    now: TickInputs, lead: Lead, center: Center, memory: Memory, law: FormationLaw, spin_rad_s: float
) -> LawInputs:
    plan, settings, fleet, rows = now.plan, now.settings, now.fleet, now.sphere
    whole, floor = len(rows) == len(fleet.ids), settings.safety.floor
    apart_m, _ = floor.kept_m(floor.worst_reserve_m(now.of_sphere(now.traits.uncertainty_m)))
    return LawInputs(
        ids=fleet.ids if whole else tuple(fleet.ids[row] for row in rows.tolist()),
        position_m=now.of_sphere(now.position_m),
        velocity_m_s=now.of_sphere(now.velocity_m_s),
        charge=now.of_sphere(now.traits.charge),
        speed_max_m_s=now.of_sphere(now.traits.speed_max_m_s),
        engaged_s=fleet.time_s - lead.engaged_time_s[rows],
        center_m=center.position_m,
        center_velocity_m_s=center.velocity_m_s,
        radius_m=lead.radius_m,
        spin_rad_s=spin_rad_s,
        target_m=np.array(plan.target.position_m(fleet.time_s)),
        target_velocity_m_s=np.array(plan.target.velocity_m_s),
        apart_m=apart_m,
        own_speed_max_m_s=settings.law.speed_m_s,
        link_delay_s=settings.safety.link_delay_s,
        dt_s=now.dt_s,
        time_s=fleet.time_s,
        settings=settings.law.own(plan.formation.law, law.settings),
        state=memory.law_state if memory.law == plan.formation.law else None,
        fleet_ids=fleet.ids,
        rows=rows,
        number=memory.number,
        stopping_speed_m_s=lambda distance_m: now.approach_max_m_s(rows, distance_m),
        fleet_velocity_m_s=now.velocity_m_s,
        expected_m_s=memory.expected_m_s,
        closed=LostSpace(now, center, lead.radius_m, memory.number),
    )


def slots_m(now: TickInputs, lead: Lead, places: Spread) -> Array:
    """(m, 3) slots of the m vehicles in formation, show frame; NaN by a law without slots."""
    if lead.center is None or places.answer.place is None:
        return np.full((len(now.rows), 3), np.nan)
    slot_m: Array = lead.center.position_m + lead.radius_m * now.of_formed(places.answer.place)
    return slot_m
