"""Decides which requested failsafes are commanded now, most severe first. Pure.

A failsafe acts once when its cause begins, and again only when it grows more severe or its cause returns.
So an operator's later command prevails. Flights and simulated flights share it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from gcs.failsafe.policy import SEVERITY, Action, Cause, FailsafePolicy
from gcs.failsafe.triggers import FailsafeRequest, Known, Roles, Seen, advance, is_calm, look
from gcs.model.state import Array

Acted = Mapping[tuple[Cause, int], int]
"""Severity of the action taken for a cause, by vehicle row; -1: the whole show."""

SHOW_ROW: Final = -1

ALL_CHECKED_S = 1.0
"""All phases are checked this often although telemetry is calm: a killed vehicle may still send telemetry."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """What is in progress already."""

    show: int  # severity
    vehicles: Array  # (n,) severity; NaN: not in the air, or not under control
    possible: frozenset[Action]  # that the show can be commanded now


def keys(request: FailsafeRequest) -> list[tuple[Cause, int]]:
    """Return the keys under which an executed request is remembered."""
    return [(request.cause, row) for row in request.rows or (SHOW_ROW,)]


def due(
    requests: Sequence[FailsafeRequest], standing: Standing, acted: Acted, together_share: float
) -> tuple[FailsafeRequest | None, tuple[FailsafeRequest, ...]]:
    """Return the commands due now, to the show and to vehicles: none twice, none weaker than what goes on.

    `requests` are all, most severe first. If `together_share` of the airborne vehicles must return, all do.
    """
    fresh = [
        request for request in requests if any(acted.get(key, 0) < request.severity for key in keys(request))
    ]
    own: dict[int, FailsafeRequest] = {}
    for request in fresh:
        for row in () if request.whole_show else request.rows:
            unanswered = acted.get((request.cause, row), 0) < request.severity
            if unanswered and request.severity > standing.vehicles[row]:
                own.setdefault(row, request)
    grouped = [
        replace(request, rows=rows)
        for request in fresh
        if (rows := tuple(row for row, best in own.items() if best is request))
    ]
    shows = [request for request in fresh if request.whole_show]
    all_vehicles = _together(requests, grouped, standing, together_share)
    if all_vehicles is not None:
        shows.append(all_vehicles)
    able = [w for w in shows if w.severity > standing.show and w.action in standing.possible]
    chosen = max(able, key=lambda request: request.severity, default=None)
    if chosen is not None:  # what the show does is not commanded again for one vehicle
        grouped = [request for request in grouped if request.severity > chosen.severity]
    return chosen, tuple(grouped)


def _together(
    requests: Sequence[FailsafeRequest], grouped: Sequence[FailsafeRequest], standing: Standing, share: float
) -> FailsafeRequest | None:
    """Return a request for a collective return if the share of vehicles that must leave is reached."""
    return_settings = [request for request in grouped if request.action is Action.RETURN]
    if not return_settings:
        return None
    leaving = {
        row
        for request in requests
        if not request.whole_show
        for row in request.rows
        if request.severity >= SEVERITY[Action.RETURN]
    }
    in_air = int(np.isfinite(standing.vehicles).sum())
    if len(leaving) < 2 or len(leaving) < share * in_air:
        return None
    first = return_settings[0]
    reason = f"{first.reason}; {len(leaving)} of {in_air} have to leave: all vehicles return home"
    return replace(first, rows=tuple(sorted(leaving)), whole_show=True, reason=reason)


@dataclass(eq=False)
class Failsafes:
    """The failsafes of one flight: what has been observed, and what has been commanded."""

    settings: FailsafePolicy
    known: Known
    _acted: dict[tuple[Cause, int], int] = field(default_factory=dict)
    _looked_s: float = -np.inf

    def look(
        self, seen: Seen, roles: Callable[[], Roles], *, active: bool
    ) -> tuple[FailsafeRequest, ...] | None:
        """Evaluate all triggers; called once a tick.

        Returns: every failsafe with a lasting cause, most severe first. None: nothing happens, and with
        nothing `active` the roles, which take long, were not looked at.
        """
        self.known, on, weather = look(seen, self.known, self.settings)
        calm = is_calm(on, self.known, seen, self.settings, weather)
        if calm and not active and seen.time_s - self._looked_s < ALL_CHECKED_S:
            return None
        self._looked_s = seen.time_s
        self.known, requests = advance(on, roles(), seen, self.known, self.settings, weather)
        return requests

    def execute(
        self,
        requests: Sequence[FailsafeRequest],
        standing: Callable[[], Standing],
        command: Callable[[FailsafeRequest], FailsafeRequest | None],
    ) -> None:
        """Command the requests that are due, and remember those that need no command any more.

        `command` executes a request, and returns it with the vehicles that could be commanded.
        """
        show, vehicles = due(requests, standing(), self._acted, self.settings.together_share)
        for request in (*(() if show is None else (show,)), *vehicles):
            done = command(request)
            if done is not None:
                self._note(keys(done), done.severity)
        goes_on, lasting = standing(), {key for request in requests for key in keys(request)}
        self._acted = {key: severity for key, severity in self._acted.items() if key in lasting}
        for request in requests:
            for key in keys(request):
                of_show = request.whole_show or key[1] == SHOW_ROW
                if (goes_on.show if of_show else goes_on.vehicles[key[1]]) >= request.severity:
                    self._note([key], request.severity)

    def _note(self, noted: Sequence[tuple[Cause, int]], severity: int) -> None:
        for key in noted:
            self._acted[key] = max(self._acted.get(key, 0), severity)
