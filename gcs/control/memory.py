"""State that one tick passes to the next: slots, routes, the way round obstacles, and what was commanded."""

from dataclasses import dataclass, replace

import numpy as np

from gcs.control.courses import Courses
from gcs.formation.laws.protocol import SlotsState
from gcs.formation.orbit import Center
from gcs.formation.route import Goal
from gcs.model.state import Array, Mask
from gcs.safety.answers import Answers
from gcs.safety.authority import Authority


@dataclass(frozen=True, slots=True, eq=False)
class Searching:
    """A plan for the centre that is being made: at most one search for a route in every tick."""

    begun_s: float
    goals: tuple[Goal, ...]  # as they were then, best first
    tried: int = 0  # searches done, of those for each goal
    widened: bool = False  # the goals have the places that can be had instead of the first


@dataclass(frozen=True, slots=True, eq=False)
class Detour:
    """The planned way of the formation's centre past obstacles. It is planned anew twice a second."""

    planned_s: float  # when
    goal: Goal  # as it was then
    corners: tuple[tuple[str, int], ...] = ()  # to pass, by obstacle id
    reaches: bool = True  # False: no way to the goal is known
    active: bool = False  # False: the law's own way is free
    clear: float = 1.0  # share of the sphere that passes clear of every obstacle
    height_m: float | None = None  # of the centre, above all obstacles on its way; None: the plan's
    best_m: float = np.inf  # least length of the way since it gained on its goal
    gained_s: float = 0.0  # when
    held_by: str = ""  # the obstacle, once the centre has made no headway for the configured time
    searching: Searching | None = None  # this detour is followed until the search ends
    courses: Courses = Courses()  # of the obstacles
    distrusted: Goal | None = None  # no way to this goal is believed while obstacles turn

    @property
    def goes_instead(self) -> bool:
        """Whether it leads to a place instead of the one where the plan leads."""
        return self.active and self.reaches and bool(self.goal.held_by)

    def goal_now(self, time_s: float) -> Goal:
        """The goal as it has moved on."""
        return self.goal.later(time_s - self.planned_s)


CORNERS = 16
"""Most corners of a route that are kept; after them it is searched again."""


@dataclass(frozen=True, slots=True, eq=False)
class GoalRoutes:
    """Routes to goals and slots past the paths of lost vehicles. Rows as in FleetState. Owns its arrays."""

    goal_m: Array  # (n, 3) goals, and slots when they were searched, to which they lead, NaN: none
    corner_m: Array  # (n, CORNERS, 3) show frame, in order, NaN after the last
    next_s: Array  # (n,) when each may be searched again
    place_m: Array  # (n, 3) that the vehicle has not left
    since_s: Array  # (n,) since then
    wary: Mask  # (n,) leads past standing vehicles, too
    passage: Mask  # (n,) leads where walls of paths closed beside it: it keeps no margin from them
    no_way: Mask  # (n,) the last search found none that reaches the goal

    @staticmethod
    def none(count: int) -> "GoalRoutes":
        """No vehicle has a route."""
        nowhere, never = np.full((count, 3), np.nan), np.full(count, -np.inf)
        corner_m, no = np.full((count, CORNERS, 3), np.nan), np.zeros(count, dtype=np.bool_)
        return GoalRoutes(nowhere, corner_m, never, nowhere, never, no, no, no)


@dataclass(frozen=True, slots=True, eq=False)
class AreaWays:
    """Ways within the fence's areas, for vehicles that do not see their goals. Rows as in FleetState."""

    corner_m: Array  # (n, 2) the next corner, NaN: none
    asked_s: Array  # (n,) when it was looked up

    @staticmethod
    def none(count: int) -> "AreaWays":
        """No vehicle has a way."""
        return AreaWays(np.full((count, 2), np.nan), np.full(count, -np.inf))


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """State that one tick passes to the next. Owns its arrays.

    Rows (n,) are as in FleetState; with other stations' vehicles these are the own ones; rows (all,) have
    the others as well, after the own.
    """

    time_s: float
    center: Center | None  # None until a formation flies
    radius_m: float
    desired_m_s: Array  # (n, 3) velocity after the safety filter, NaN where not commanded
    unfiltered_m_s: Array  # (n, 3) before it, NaN where not commanded
    asked_m_s: Array  # (n, 3) the first; of those that yield to a lack of authority what the law requires
    setpoint_m_s: Array  # (n, 3) as sent for it, less the trim; NaN where not commanded
    yaw_rad: Array  # (n,) commanded, NaN where not commanded
    held_yaw_rad: Array  # (n,) at engagement
    engaged_time_s: Array  # (all,) when it joined the formation, NaN outside
    trim_m_s: Array  # (n, 3) correction of setpoints for wind, drag and the vehicle's own response
    expected_m_s: Array  # (n, 3) velocity relative to the centre's that each should have, NaN: not commanded
    pace: float  # share of the orbit's speed that the vehicles can keep up with
    sides: dict[str, float]
    authority: Authority
    answers: Answers  # compared with what the vehicles' profiles say
    number: int = 0  # of ticks so far
    spin_rad_s: float = 0.0  # of the formation now, on its way to the plan's
    detour: Detour | None = None  # of the formation's centre round obstacles, None without any
    law: str = ""  # that the state belongs to
    law_state: object = None  # as the law returned it
    led_m_s: Array | None = (
        None  # (all, 3) its velocities for vehicles of other stations as well, relative to
    )
    # the centre, NaN: they hold; None: it is not computed for others
    routes: GoalRoutes | None = None  # (all,) to goals and slots, None while no vehicle is lost
    ways: AreaWays | None = None  # (all,) within the fence's areas, None without any
    no_way_s: Array | None = None  # (all,) since when no way round obstacles leads to a goal; inf: one may
    waits_at_m: Array | None = None  # (all, 3) where it waits for a way; NaN: it does not; None: all fly

    @property
    def slots(self) -> SlotsState | None:
        """Slots for the next tick; None by a law without slots."""
        return self.law_state if isinstance(self.law_state, SlotsState) else None

    @property
    def place(self) -> Array:
        """(all, 3) slots for the next tick: unit vectors from the centre, NaN outside the formation."""
        nowhere = np.full((len(self.engaged_time_s), 3), np.nan)
        return nowhere if self.slots is None else self.slots.place

    @property
    def unfollowed_s(self) -> Array | None:
        """(all,) how long each vehicle did not move as expected; negative: its slot stays with it."""
        return None if self.slots is None else self.slots.unfollowed_s

    def of_own(self, count: int) -> "Memory":
        """The same with `count` rows (n,), which it has after its first tick."""
        if len(self.yaw_rad) == count:
            return self
        names = "desired_m_s", "unfiltered_m_s", "asked_m_s", "setpoint_m_s", "yaw_rad", "held_yaw_rad"
        rows = {name: getattr(self, name)[:count] for name in (*names, "trim_m_s", "expected_m_s")}
        return replace(self, **rows, authority=self.authority.first(count), answers=self.answers.first(count))

    @staticmethod
    def fresh(count: int, time_s: float) -> "Memory":
        """The state before the first tick, of all rows: nothing is commanded."""
        nothing, nowhere, still = np.full(count, np.nan), np.full((count, 3), np.nan), np.zeros((count, 3))
        return Memory(
            time_s=time_s,
            center=None,
            radius_m=0.0,
            desired_m_s=nowhere,
            unfiltered_m_s=nowhere,
            setpoint_m_s=nowhere,
            asked_m_s=nowhere,
            yaw_rad=nothing,
            held_yaw_rad=nothing,
            engaged_time_s=nothing,
            trim_m_s=still,
            expected_m_s=nowhere,
            pace=1.0,
            sides={},
            authority=Authority.full(count),
            answers=Answers.none(count),
        )
