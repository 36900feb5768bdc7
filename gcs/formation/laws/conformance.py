"""What every law must keep, shipped or not: shapes, finite numbers, the same answer twice, no array changed.

A law that says `turns_alike` turns with its inputs. Time is measured by `gcs law check`, which has a clock.
"""

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Final

import numpy as np

from gcs.formation.law import turned
from gcs.formation.laws.protocol import FormationLaw, LawAnswer, LawInputs
from gcs.model.errors import InvalidError
from gcs.model.settings import Settings
from gcs.model.state import Array

COUNTS: Final = (1, 2, 5, 30)
TICKS: Final = 200
"""Ticks that each number of vehicles is flown: 10 s."""

FASTEST: Final = 5.0
"""A law may ask for so many times the speed that it was given as its limit; the rest is cut off."""

ANGLE_RAD: Final = 2.0

OF_ROWS: Final = ("position_m", "velocity_m_s", "charge", "speed_max_m_s", "engaged_s")
"""What each vehicle has a row in."""


def sample(count: int, settings: Settings, *, far_m: float = 0.0) -> LawInputs:
    """Vehicles above a grid, 5 m apart and `far_m` off the centre, that have just joined."""
    at = np.arange(count)
    side = int(np.ceil(np.sqrt(count)))
    position_m = np.column_stack([5.0 * (at % side) + far_m, 5.0 * (at // side), np.full(count, -5.0)])
    return LawInputs(
        ids=tuple(f"d{row + 1}" for row in at),
        position_m=position_m.astype(np.float64),
        velocity_m_s=np.zeros((count, 3)),
        charge=np.ones(count),
        speed_max_m_s=np.full(count, np.inf),
        engaged_s=np.zeros(count),
        center_m=np.array([4.0, 3.0, -30.0]),
        center_velocity_m_s=np.zeros(3),
        radius_m=max(10.0, 1.4 * side),
        spin_rad_s=0.0,
        target_m=np.zeros(2),
        target_velocity_m_s=np.zeros(2),
        apart_m=3.5,
        own_speed_max_m_s=4.0,
        link_delay_s=0.0,
        dt_s=0.05,
        time_s=0.0,
        settings=settings,
    )


def answered(law: FormationLaw, inputs: LawInputs) -> LawAnswer:
    """The law's answer, with an array of numbers. Raises: InvalidError for what is no answer."""
    answer: object = law.velocity(inputs)
    if not isinstance(answer, LawAnswer):
        kind = "None" if answer is None else type(answer).__name__
        raise InvalidError("velocity()", kind, "a LawAnswer is needed: return LawAnswer(velocities)")
    array: object = answer.velocity_m_s
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        kind = f"an array of {array.dtype}" if isinstance(array, np.ndarray) else type(array).__name__
        raise InvalidError("LawAnswer.velocity_m_s", kind, "a numpy array of floats is needed, (n, 3)")
    return answer


def flown(law: FormationLaw, inputs: LawInputs, ticks: int) -> Iterator[tuple[LawInputs, LawAnswer]]:
    """Fly vehicles that follow at once: the inputs of every tick, and the answer. Raises: InvalidError."""
    for _ in range(ticks):
        answer = answered(law, inputs)
        yield inputs, answer
        inputs = replace(
            inputs,
            position_m=inputs.position_m + inputs.dt_s * answer.velocity_m_s,
            velocity_m_s=answer.velocity_m_s.copy(),
            engaged_s=inputs.engaged_s + inputs.dt_s,
            time_s=inputs.time_s + inputs.dt_s,
            state=answer.next_state(),
        )


def problems(law: FormationLaw) -> Iterator[str]:
    """What the law does not keep, in words."""
    try:
        yield from _problems(law)
    except InvalidError as error:
        yield str(error)


def _problems(law: FormationLaw) -> Iterator[str]:
    for count in COUNTS:
        for far_m in (0.0, 150.0):
            begin = sample(count, law.settings(), far_m=far_m)
            for inputs, answer in flown(law, begin, TICKS):
                wrong = why_wrong(answer.velocity_m_s, inputs)
                if wrong:
                    yield f"{count} vehicles, {inputs.time_s:.2f} s: {wrong}"
                    return
    for check in (_repeated, _unchanged, _turned, _reordered, _rejoined):
        yield from check(law, sample(7, law.settings()))


def why_wrong(velocity_m_s: Array, inputs: LawInputs) -> str:
    """Which bound an answer breaks, in words; empty: none."""
    shape = (len(inputs.ids), 3)
    if velocity_m_s.shape != shape:
        return f"it returned an array of shape {velocity_m_s.shape}; {shape} is needed"
    if not np.isfinite(velocity_m_s).all():
        row = int(np.flatnonzero(~np.isfinite(velocity_m_s).all(axis=1))[0])
        return f"its velocity of {inputs.ids[row]} is {velocity_m_s[row].tolist()}"
    fastest_m_s = np.linalg.norm(velocity_m_s, axis=1).max(initial=0.0)
    most_m_s = FASTEST * inputs.own_speed_max_m_s
    if fastest_m_s > most_m_s:
        return f"it asks for {fastest_m_s:.3g} m/s, more than {most_m_s:g} m/s"
    return ""


def _all(law: FormationLaw, inputs: LawInputs) -> Array:
    """(ticks, n, 3) velocities of 2 s."""
    return np.array([answer.velocity_m_s for _, answer in flown(law, inputs, 40)])


def _repeated(law: FormationLaw, inputs: LawInputs) -> Iterator[str]:
    if not np.array_equal(_all(law, inputs), _all(law, inputs)):
        yield "the same inputs have different answers: it keeps something, draws numbers or reads a clock"


def _unchanged(law: FormationLaw, inputs: LawInputs) -> Iterator[str]:
    before = {field.name: np.copy(getattr(inputs, field.name)) for field in fields(inputs)[1:9]}
    law.velocity(inputs)
    changed = [name for name, value in before.items() if not np.array_equal(value, getattr(inputs, name))]
    if changed:
        yield f"it changes its inputs: {', '.join(changed)}"


def _turned(law: FormationLaw, inputs: LawInputs) -> Iterator[str]:
    there = replace(
        inputs,
        position_m=turned(inputs.position_m - inputs.center_m, ANGLE_RAD) + inputs.center_m,
        target_m=turned(np.append(inputs.target_m, 0.0)[None], ANGLE_RAD)[0, :2],
    )
    if law.turns_alike and not np.allclose(
        turned(law.velocity(inputs).velocity_m_s, ANGLE_RAD), law.velocity(there).velocity_m_s, atol=1e-6
    ):
        yield f"its velocities do not turn with vehicles that are turned by {ANGLE_RAD:g} rad"


def _reordered(law: FormationLaw, inputs: LawInputs) -> Iterator[str]:
    """Each station has its own vehicles first."""
    order = np.roll(np.arange(len(inputs.ids)), 3)
    rows = {name: getattr(inputs, name)[order] for name in OF_ROWS}
    there = replace(inputs, ids=tuple(inputs.ids[row] for row in order.tolist()), **rows)
    here_m_s, there_m_s = answered(law, inputs).velocity_m_s, answered(law, there).velocity_m_s
    if law.stations == "local" and not np.allclose(here_m_s[order], there_m_s, atol=1e-6):
        yield "its velocities depend on the order of the rows, which stations differ in: use `ids`, or led"


def _rejoined(law: FormationLaw, inputs: LawInputs) -> Iterator[str]:
    """A vehicle leaves, and the rest are flown on with the state of before."""
    *_, (last, answer) = flown(law, inputs, 20)
    fewer = sample(len(inputs.ids) - 1, inputs.settings)
    fewer = replace(
        fewer,
        time_s=last.time_s + last.dt_s,
        state=answer.next_state(),
        fleet_ids=inputs.ids,
        rows=np.arange(len(fewer.ids)),
        fleet_velocity_m_s=np.zeros((len(inputs.ids), 3)),
    )
    wrong = why_wrong(law.velocity(fewer).velocity_m_s, fewer)
    if wrong:
        yield f"after a vehicle has left: {wrong}"
