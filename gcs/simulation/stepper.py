"""A simulated flight tick by tick, with velocities of a program instead of the law's: for learning."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs.flight.state.ticker import garbage_between_ticks
from gcs.model.errors import ConfigError, InvalidError, RefusedError, ShapeError, quoted
from gcs.model.state import Array, Mask
from gcs.simulation.flight import measured, prepared, require_scenario
from gcs.simulation.record import NOWHERE, FlightDetails
from gcs.simulation.result import FlightResult
from gcs.simulation.scenario import Scenario
from gcs.simulation.simulated_flight import SimulatedFlight


@dataclass(frozen=True, slots=True, eq=False)
class StepState:
    """A flight of n vehicles after a step, in the show frame. Owns its arrays.

    What was decided (from `setpoint_m_s` on) is of the step before; NaN, and "" of `limited_by`: nothing was.
    """

    time_s: float
    position_m: Array  # (n, 3) true
    velocity_m_s: Array  # (n, 3) true
    received_m: Array  # (n, 3) as the station received it last: late, and with the vehicles' own errors
    received_m_s: Array  # (n, 3) likewise
    in_air: Mask  # (n,)
    task: NDArray[np.int8]  # (n,) of `Task`
    target_m: Array  # (2,) true place of the target on the ground
    centre_m: Array  # (3,) commanded centre of the sphere
    radius_m: float
    setpoint_m_s: Array  # (n, 3) as sent
    proposed_m_s: Array  # (n, 3) of the law, or as given, as far as vehicles can change their velocity
    allowed_m_s: Array  # (n, 3) what the safety filter left of it
    limited_by: tuple[str, ...]  # (n,) why the filter changed it
    closest_m: float  # least distance of two in the step, as in `FlightResult`; NaN: before the first

    @staticmethod
    def of(flight: SimulatedFlight) -> "StepState":
        world, memory, decided = flight.world, flight.memory, flight.decided
        n = len(world.ids)
        center_m = NOWHERE if memory.center is None else memory.center.position_m
        return StepState(
            world.time_s,
            world.position_m.copy(),
            world.velocity_m_s.copy(),
            world.received_m.copy(),
            world.received_m_s.copy(),
            world.in_air & flight.present,
            flight.task.copy(),
            flight.true_target_m().copy(),
            center_m.copy(),
            memory.radius_m,
            np.full((n, 3), np.nan) if decided is None else world.of_all(decided.setpoints),
            memory.unfiltered_m_s.copy(),
            memory.desired_m_s.copy(),
            ("",) * n if decided is None else decided.limited_by,
            flight.record.closest_m[-1] if flight.record.closest_m else np.nan,
        )


class Stepper:
    """Flies a scenario step by step, 20 a second unless the world has another `tick_rate_hz`.

    Within `with`, the garbage collector runs between the steps, as in flight.
    """

    def __init__(self, scenario: Scenario, vehicles: int | None = None, seed: int = 1) -> None:
        """Arguments and errors as of `fly`, with one more.

        Raises: ConfigError for a scenario of the article or of several stations, which have no common tick.
        """
        require_scenario(scenario)
        self.scenario = scenario
        self._vehicles, self._seed = vehicles, seed
        self._inside = ExitStack()
        self._collect: Callable[[float], None] = lambda _: None
        self._flight = self._prepared(seed)

    def __enter__(self) -> Self:
        self._collect = self._inside.enter_context(garbage_between_ticks())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._collect = lambda _: None
        self._inside.close()

    def reset(self, seed: int | None = None) -> StepState:
        """Begin anew, with the same seed or another."""
        self._seed = self._seed if seed is None else seed
        self._flight = self._prepared(self._seed)
        self._flight.get_ready()
        return StepState.of(self._flight)

    def step(self, velocities_m_s: ArrayLike | None = None) -> tuple[StepState, bool]:
        """Fly one tick.

        Args:
            velocities_m_s: (n, 3) in the show frame, desired instead of the law's; None: the law's. The limit
                of acceleration and the safety filter follow, as always. A vehicle that a failsafe, the return
                or a drawn show leads does not follow them.

        Returns: the state, and whether the flight is over.

        Raises:
            ShapeError: another shape.
            InvalidError: a velocity is not finite.
            RefusedError: the flight is over.
        """
        flight = self._flight
        if flight.is_over:
            raise RefusedError("the flight is over: begin a new one by reset()")
        flight.proposed_m_s = None if velocities_m_s is None else self._accepted(velocities_m_s)
        flight.step()
        self._collect(flight.time_s)
        return StepState.of(flight), flight.is_over

    def result(self) -> FlightResult:
        """The flight so far, as `fly` returns it. Raises: RefusedError before the first step."""
        if not self._flight.record.time_s:
            raise RefusedError("nothing was flown: call step() first")
        return FlightResult.of(self._flight.record, measured(self.scenario, self._flight))

    def _prepared(self, seed: int) -> SimulatedFlight:
        if self.scenario.divided.count > 1:
            raise ConfigError(f"{self.scenario.name}: several stations divide its vehicles: use fly()")
        flight = prepared(self.scenario, self._vehicles, seed)
        if not isinstance(flight, SimulatedFlight):
            raise ConfigError(f"{self.scenario.name}: the article's flight has no tick of control: use fly()")
        flight.record.details = FlightDetails()
        return flight

    def _accepted(self, velocities_m_s: ArrayLike) -> Array:
        expected = len(self._flight.task), 3
        try:
            given_m_s = np.array(velocities_m_s, np.float64)
        except (TypeError, ValueError):
            text = f"numbers of the shape {expected}, in m/s"
            raise InvalidError("velocities_m_s", quoted(velocities_m_s), text) from None
        if given_m_s.shape != expected:
            raise ShapeError(f"velocities_m_s has the shape {given_m_s.shape}: {expected} is needed")
        if not np.isfinite(given_m_s).all():
            row = int(np.flatnonzero(~np.isfinite(given_m_s).all(axis=1))[0])
            raise InvalidError(f"velocities_m_s[{row}]", given_m_s[row].tolist(), "finite numbers, in m/s")
        return given_m_s
