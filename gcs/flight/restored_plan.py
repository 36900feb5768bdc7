"""The plan of an interrupted flight: read from the record, merged with later commands, checked."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

from gcs.flight.fleet import Fleet
from gcs.flight.show_player import ShowPlayer
from gcs.model.errors import GcsError, RefusedError
from gcs.model.interrupted_flight import TAKEN_OVER_FROM, Interruption, Offer
from gcs.model.plan import MAX_OBSTACLES, Obstacle, Plan, plan_of
from gcs.planning.feasibility import check_formation, check_orbit, check_target, followed

log = logging.getLogger(__name__)


def merged_obstacles(
    recorded: Sequence[Obstacle], configured: Sequence[Obstacle], now: Sequence[Obstacle]
) -> tuple[Obstacle, ...]:
    """Merge recorded obstacles with an operator's changes since the restart: the newest command counts.

    Args:
        recorded: of the interrupted flight.
        configured: those of the plan with which this service began.
        now: those of the plan at this time.
    """
    before, standing = {box.id: box for box in configured}, {box.id for box in now}
    changed = [box for box in now if before.get(box.id) != box]
    decided = {box.id for box in changed} | (before.keys() - standing)
    return (*(box for box in recorded if box.id not in decided), *changed)


class RestoredPlan:
    """Restores the plan of an interrupted flight, once for each offer. Changed on the event loop only."""

    def __init__(self, flight: Fleet, show_player: ShowPlayer, unix_s: Callable[[], float]) -> None:
        self._flight = flight
        self._show_player = show_player
        self._unix_s = unix_s
        self._configured = flight.plan
        self._restored: set[Offer] = set()

    @property
    def is_taken_over(self) -> bool:
        """Whether the whole plan was restored: from then on the present plan counts."""
        return Offer.TAKE_OVER in self._restored

    def forget(self) -> None:
        """Forget the interruption: a later one is restored anew."""
        self._restored.clear()

    def why_not(self, found: Interruption) -> str:
        """Why no vehicle can return to the formation; empty when they can."""
        if found.show not in TAKEN_OVER_FROM:
            return f"take-over is not offered: the show was {found.show}"
        try:
            if found.stalled_s is not None and found.plan is None:
                return ""  # the plan that was flown still applies
            if found.written is not None:
                self._show_player.find(found.written.name, found.written.hash)
            else:
                self._checked(found)
        except GcsError as error:
            return f"take-over is not offered: {error}"
        return ""

    def restore(self, found: Interruption, offer: Offer) -> None:
        """Restore the whole plan to take over, or its obstacles to return the vehicles.

        Raises: RefusedError if a take-over cannot fly it; a return is never refused.
        """
        if found.plan is None and found.stalled_s is not None:
            return  # the service has kept it
        if not self._restored.isdisjoint({offer, Offer.TAKE_OVER}):
            return
        if offer is Offer.BRING_HOME:
            self._restore_obstacles(found)
        else:
            plan = self._checked(found)
            if found.written is None:
                self._flight.plan = plan
            elif self._flight.show_run is None:
                self._show_player.resume(found.written, plan)
        self._restored.add(offer)

    def _restore_obstacles(self, found: Interruption) -> None:
        """Restore as many obstacles as are allowed; an unreadable record has none."""
        flight = self._flight
        if found.plan is None or flight.show_run is not None:
            return
        try:
            recorded = self._recorded(found).obstacles
        except RefusedError as error:
            log.warning("obstacles_not_restored", extra={"reason": str(error)})
            return
        merged = merged_obstacles(recorded, self._configured.obstacles, flight.plan.obstacles)
        if len(merged) > MAX_OBSTACLES:
            reason = f"{len(merged)} obstacles, at most {MAX_OBSTACLES} stand: the oldest are left out"
            log.warning("obstacles_not_restored", extra={"reason": reason})
        flight.plan = replace(flight.plan, obstacles=merged[-MAX_OBSTACLES:])

    def _recorded(self, found: Interruption) -> Plan:
        """The recorded plan, with target and obstacles moved to now. Raises: RefusedError if unreadable."""
        if found.plan is None:
            raise RefusedError("what was flown is not in the record")
        now_s = self._flight.fleet.time_s
        try:
            shift_s = now_s - (self._unix_s() - found.unix_s) - float(found.plan["time_s"])
            return plan_of(found.plan, shift_s)
        except (GcsError, KeyError, TypeError, ValueError) as error:
            raise RefusedError(f"the plan of the record cannot be read: {error!r}") from None

    def _merged(self, found: Interruption) -> Plan:
        """The recorded plan with an operator's changes since the restart. Raises: RefusedError."""
        recorded, configured, now = self._recorded(found), self._configured, self._flight.plan
        merged = merged_obstacles(recorded.obstacles, configured.obstacles, now.obstacles)
        if len(merged) > MAX_OBSTACLES:
            text = f"{len(merged)} obstacles, with those of the interrupted flight; at most {MAX_OBSTACLES}"
            raise RefusedError(f"{text}: remove {len(merged) - MAX_OBSTACLES}")
        return Plan(
            formation=recorded.formation if now.formation == configured.formation else now.formation,
            orbit=recorded.orbit if now.orbit == configured.orbit else now.orbit,
            target=recorded.target if now.target == configured.target else now.target,
            obstacles=merged,
            yaw=recorded.yaw if now.yaw == configured.yaw else now.yaw,
        )

    def _checked(self, found: Interruption) -> Plan:
        """The merged plan, if it may be flown. Raises: RefusedError."""
        plan, control = self._merged(found), self._flight.control
        if found.written is not None:
            return plan  # checked as a whole, under its own limits
        try:
            check_formation(plan.formation, max(1, len(found.vehicles)), control.safety)
            check_orbit(plan.orbit, control.law)
            target = followed(plan, self._flight.fleet.time_s, control.safety.fence)
            check_target(target, plan.orbit, plan.formation, control)
        except GcsError as error:
            raise RefusedError(f"what was flown cannot be flown now: {error}") from None
        return plan
