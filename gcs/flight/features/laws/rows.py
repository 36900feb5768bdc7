"""What a flight and the process of a law share: one table of numbers, and lines of JSON beside it."""

import json
from dataclasses import dataclass
from mmap import mmap
from typing import Any, Final

import numpy as np

from gcs.formation.laws.protocol import LawInputs
from gcs.model.settings import Settings
from gcs.model.state import Array

COLUMNS: Final = 12
"""Position, velocity, charge, greatest speed and time since it joined of each vehicle; the answer."""

ANSWER: Final = slice(9, 12)

SCALARS: Final = (
    *("radius_m", "spin_rad_s", "apart_m", "own_speed_max_m_s", "link_delay_s", "dt_s", "time_s"),
    *("center_m", "center_velocity_m_s", "target_m", "target_velocity_m_s"),
)


@dataclass(frozen=True, slots=True)
class Declared:
    """What a law says of itself once its process has begun."""

    goal_shape: str
    adds_spin: bool
    stations: str


def table_in(memory: mmap) -> Array:
    """(rows, COLUMNS) the numbers in shared memory."""
    return np.frombuffer(memory, np.float64).reshape(-1, COLUMNS)


def size_of(rows: int) -> int:
    return max(rows, 1) * COLUMNS * 8


def line(values: Any) -> bytes:
    return json.dumps(values, separators=(",", ":")).encode() + b"\n"


def handed_over(inputs: LawInputs, table: Array, *, named: bool, anew: bool = False) -> bytes:
    """Put the inputs of n vehicles into the table.

    Returns: the rest of them; `named`: with the ids; `anew`: the law has no state any more.
    """
    rows = table[: len(inputs.ids)]
    rows[:, 0:3], rows[:, 3:6] = inputs.position_m, inputs.velocity_m_s
    rows[:, 6], rows[:, 7], rows[:, 8] = inputs.charge, inputs.speed_max_m_s, inputs.engaged_s
    values = {name: np.asarray(getattr(inputs, name)).tolist() for name in SCALARS}
    return line(values | ({"ids": inputs.ids} if named else {}) | ({"anew": True} if anew else {}))


def received(values: dict[str, Any], table: Array, before: LawInputs | None, settings: Settings) -> LawInputs:
    """The inputs that `handed_over` has put there, with the ids of `before` unless it names others."""
    ids = tuple(values["ids"]) if before is None or "ids" in values else before.ids
    rows = table[: len(ids)].copy()
    rows.flags.writeable = False
    scalars = {name: values[name] for name in SCALARS}
    vectors = {name: np.array(value) for name, value in scalars.items() if isinstance(value, list)}
    return LawInputs(
        ids=ids,
        position_m=rows[:, 0:3],
        velocity_m_s=rows[:, 3:6],
        charge=rows[:, 6],
        speed_max_m_s=rows[:, 7],
        engaged_s=rows[:, 8],
        settings=settings,
        state=None if before is None or "anew" in values else before.state,
        **(scalars | vectors),
    )
