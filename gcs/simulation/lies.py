"""Vehicles of a simulated world that report what is not so, and what came of it."""

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from gcs.estimation.contradictions import LATE_S
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array, Mask

FROZEN, WRONG_SIGN, LATE, LATER, JUMP, JUMPS = "frozen", "wrong-sign", "late", "later", "jump", "jumps"


class Lies(Settings):
    """A share of the vehicles, at random, reports what is not so from a time on: each in its own way."""

    kinds: tuple[Literal["frozen", "wrong-sign", "late", "later", "jump", "jumps"], ...] = ("frozen",)
    """By turns, from the first that lies on.

    `frozen`: its position repeats; `wrong-sign`: its velocity has it; `late`: all that it sends, from one
    moment on, or `later` and later; `jump`, `jumps`: its position does, once or several times.
    """
    share_min: NotNegative = 0.01
    """At least so many of the vehicles, but one."""
    share_max: NotNegative = 0.2
    """At most so many of them."""
    from_s: Positive = 35.0
    """When they begin."""
    late_s: Positive = 1.5
    """By how much it is late in the end."""
    later_by: Positive = 0.5
    """By how much `later` grows each second."""
    jump_m: Positive = 4.0
    """Length of the jump of `jump`, in any direction."""
    jumps: tuple[int, Positive, Positive] = (5, 3.0, 5.0)
    """How many, their length in m, and the time between two."""

    @model_validator(mode="after")
    def _is_some(self) -> "Lies":
        if not self.kinds:
            raise ValueError("kinds: at least one")
        if not 0.0 <= self.share_min <= self.share_max <= 1.0:
            raise ValueError(f"share_min {self.share_min:g} <= share_max {self.share_max:g} <= 1")
        return self


NEVER: Final = np.inf


@dataclass(slots=True, eq=False)
class Liars:
    """Which of n vehicles lie, how, and since when; and what the flight made of it. Filled as it flies.

    Attributes:
        kind: (n,) of its lies, "" of those that report truly.
        begins_s: (n,) when a sample arrives first that is a lie; inf: never.
        named_s: (n,) when the flight named it to its operator; inf: never.
        flown_m: (n,) way that it truly flew in formation, by setpoints, while it lied. A vehicle with a
            position that jumps counts until it was named: others keep clear of both places then.
    """

    kind: NDArray[np.str_]
    begins_s: Array
    named_s: Array = field(init=False)
    flown_m: Array = field(init=False)

    def __post_init__(self) -> None:
        self.named_s = np.full(len(self.kind), NEVER)
        self.flown_m = np.zeros(len(self.kind))

    @staticmethod
    def drawn(lies: Lies, count: int, delay_s: float, seed: int) -> "Liars":
        """Draw them, by a random stream of their own. `delay_s`: of what arrives in time."""
        random = np.random.default_rng([seed, 11])
        share = random.uniform(lies.share_min, lies.share_max)
        rows = random.choice(count, max(1, round(share * count)), replace=False)
        kind, begins_s = np.full(count, "", dtype="<U16"), np.full(count, NEVER)
        kind[rows] = [lies.kinds[turn % len(lies.kinds)] for turn in range(len(rows))]
        begins_s[rows] = lies.from_s + delay_s
        begins_s[kind == LATE] += lies.late_s  # before that nothing arrives
        begins_s[kind == LATER] += LATE_S / lies.later_by  # before that links are as late that are flown with
        return Liars(kind, begins_s)

    @property
    def rows(self) -> Mask:
        """(n,) those that lie."""
        return np.asarray(self.kind != "")

    @property
    def jumping(self) -> Mask:
        """(n,) vehicles with positions that jump."""
        return np.isin(self.kind, (JUMP, JUMPS))

    def note(self, now_s: float, named: Mask, steered: Mask, way_m: Array) -> None:
        """Take a tick: (n,) which are named, which fly in formation by a setpoint, and how far they flew."""
        newly = named & (self.named_s == NEVER) & (now_s >= self.begins_s - LATE_S)
        self.named_s[newly | (named & ~self.rows & (self.named_s == NEVER))] = now_s
        counts = self.rows & steered & (now_s >= self.begins_s)
        counts &= ~(self.jumping & (self.named_s < NEVER))
        self.flown_m[counts] += way_m[counts]


@dataclass(frozen=True, slots=True)
class LieFigures:
    """What came of vehicles that reported what was not so."""

    liars: int
    violations: int  # pairs of vehicles that report truly, below the floor
    named_s: float | None  # after its first lie, of the vehicle that was named last; None: one was not
    flown_on_a_lie_m: float  # by the vehicle that flew farthest
    wrongly_named: int  # vehicles that report truly


def lie_figures(liars: Liars, violating: set[tuple[int, int]]) -> LieFigures:
    """Figures of a flight in which these pairs came below the floor."""
    lying = liars.rows
    took_s = np.maximum(liars.named_s[lying] - liars.begins_s[lying], 0.0)
    return LieFigures(
        liars=int(lying.sum()),
        violations=sum(not (lying[one] or lying[other]) for one, other in violating),
        named_s=round(float(took_s.max()), 3) if np.isfinite(took_s).all() else None,
        flown_on_a_lie_m=round(float(liars.flown_m.max()), 3),
        wrongly_named=int(np.isfinite(liars.named_s[~lying]).sum()),
    )
