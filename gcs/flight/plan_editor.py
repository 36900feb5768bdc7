"""Checks an operator's changes against the flight before they become the plan."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from gcs.flight.fleet import Fleet
from gcs.flight.show_player import ShowPlayer
from gcs.flight.vehicle import Vehicle
from gcs.model.errors import RefusedError, UnknownError
from gcs.model.lifecycle import ON_THE_GROUND, Phase
from gcs.model.plan import MAX_OBSTACLES, Formation, Obstacle, Orbit, Target, Yaw
from gcs.planning.feasibility import (
    check_formation,
    check_obstacle,
    check_orbit,
    check_radius,
    check_target,
    followed,
)


class PlanEditor:
    """Changes the plan of a flight, or refuses the change. See `gcs.service.Service` for each method."""

    def __init__(
        self,
        flight: Fleet,
        show_player: ShowPlayer,
        taking_part: Callable[[], Sequence[Vehicle]],
        now_s: Callable[[], float],
    ) -> None:
        """`taking_part` returns the vehicles in the air or about to take off; `now_s` is the loop's clock."""
        self._flight = flight
        self._show_player = show_player
        self._taking_part = taking_part
        self._now_s = now_s

    def set_formation(self, formation: Formation) -> None:
        """Change radius and height; a refusal names values that are accepted."""
        flight = self._flight
        self._show_player.need_free("formation")
        count = 1 if flight.show in ON_THE_GROUND else max(1, len(self._taking_part()))
        target, control, was = self._followed(), flight.control, flight.plan.formation
        if formation.height_m == was.height_m and formation.radius_m > was.radius_m:
            check_radius(formation.radius_m, formation.height_m, target, flight.plan.orbit, control.safety)
        check_formation(formation, count, control.safety)
        check_target(target, flight.plan.orbit, formation, control, changed="formation")
        flight.plan = replace(flight.plan, formation=formation)

    def set_orbit(self, orbit: Orbit) -> None:
        """Change how the centre circles the target."""
        flight = self._flight
        self._show_player.need_free("orbit")
        control = flight.control
        check_orbit(orbit, control.law)
        check_target(self._followed(), orbit, flight.plan.formation, control, changed="orbit")
        flight.plan = replace(flight.plan, orbit=orbit)

    def set_target(self, target: Target) -> None:
        """Set the target's position and velocity."""
        self._show_player.tell_target(replace(target, time_s=self._now_s()))

    def _followed(self) -> Target:
        """Return the target as it is followed at this time."""
        now_s = self._now_s()
        return followed(self._flight.plan, now_s, self._flight.control.safety.fence)

    def set_yaw(self, yaw: Yaw) -> None:
        """Change the vehicles' heading."""
        self._flight.plan = replace(self._flight.plan, yaw=yaw)

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Add a box-shaped obstacle."""
        self._show_player.need_own_obstacle(obstacle.id)
        if any(known.id == obstacle.id for known in self._flight.plan.obstacles):
            raise RefusedError(f"there is an obstacle {obstacle.id} already; change or remove it")
        if len(self._flight.plan.obstacles) + self._show_player.reserved >= MAX_OBSTACLES:
            raise RefusedError(f"there are {MAX_OBSTACLES} obstacles already, the most possible; remove one")
        self._place_obstacle(obstacle)

    def change_obstacle(self, obstacle: Obstacle) -> None:
        """Replace the obstacle of the same id."""
        self._need_obstacle(obstacle.id)
        self._place_obstacle(obstacle)

    def remove_obstacle(self, obstacle_id: str) -> None:
        """Remove an obstacle."""
        self._need_obstacle(obstacle_id)
        self._set_obstacles([known for known in self._flight.plan.obstacles if known.id != obstacle_id])

    def _need_obstacle(self, obstacle_id: str) -> None:
        self._show_player.need_own_obstacle(obstacle_id)
        known = [obstacle.id for obstacle in self._flight.plan.obstacles]
        if obstacle_id not in known:
            raise UnknownError(f"there is no obstacle {obstacle_id}; there are {', '.join(known) or 'none'}")

    def _place_obstacle(self, obstacle: Obstacle) -> None:
        flight = self._flight
        obstacle = replace(obstacle, time_s=self._now_s())
        comes_down_m = {
            vehicle.id: vehicle.goal_m if vehicle.phase is Phase.LANDING else vehicle.home_m
            for vehicle in self._taking_part()
        }
        check_obstacle(
            obstacle,
            flight.control.law.avoidance,
            {vehicle.id: flight.position_m(vehicle) for vehicle in flight.airborne},
            {name: place_m for name, place_m in comes_down_m.items() if place_m is not None},
            velocities_m_s={
                vehicle.id: flight.fleet.velocity_m_s[vehicle.row] for vehicle in flight.airborne
            },
            braking=flight.control.safety.braking,
        )
        others = [known for known in flight.plan.obstacles if known.id != obstacle.id]
        self._set_obstacles([*others, obstacle])

    def _set_obstacles(self, obstacles: Sequence[Obstacle]) -> None:
        self._flight.plan = replace(self._flight.plan, obstacles=tuple(obstacles))
