"""The collective return of a site: the lead plans for all, and sends each station its vehicles' paths."""

from collections.abc import Callable
from math import nan
from typing import Protocol

import numpy as np

from gcs.control.others import Others
from gcs.flight.state.elsewhere import Returning, ReturnsElsewhere
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, Mask
from gcs.planning.return_paths.paths import ReturnPaths
from gcs.site.sender import SiteSender
from gcs.stations.reported_vehicles import Rows
from gcs.stations.return_messages import ReturnMessage
from gcs.stations.site import Site


class SiteKnowledge(Protocol):
    """What the return needs to know of the site at this tick; `SiteMember` implements it."""

    @property
    def lead_is_here(self) -> bool:
        """Whether this station leads, or receives the one that does."""

    @property
    def others(self) -> Others:
        """The other stations' vehicles."""

    def show_of(self, station: str) -> ShowPhase:
        """Phase of that station's show."""

    def flown_by_others(self, *phases: Phase) -> Rows:
        """(j,) rows of the vehicles of received stations in one of these phases."""


class SiteReturns(ReturnsElsewhere):
    """The part of the other stations' vehicles. Used on the event loop only."""

    def __init__(
        self, site: Site, knowledge: SiteKnowledge, sender: SiteSender, now_s: Callable[[], float]
    ) -> None:
        """`now_s`: time of this tick."""
        self._site, self._known, self._sender, self._now_s = site, knowledge, sender, now_s
        self._newest = 0  # number of the newest return that was received
        self._parts: dict[int, ReturnMessage] = {}  # its parts, by first row

    @property
    def plans_returns(self) -> bool | None:
        """Whether this station plans a return for all; False: another does; None: each for its own."""
        return self._site.lead.leads if self._known.lead_is_here else None

    @property
    def lead_returns(self) -> bool:
        """Whether the lead's show is on its way home, so that it plans for all."""
        return self._known.show_of(self._site.lead.name) is ShowPhase.RETURNING

    @property
    def newest(self) -> int:
        return self._newest

    def take(self, message: ReturnMessage) -> None:
        """Take a part of the paths that the lead has sent for own vehicles."""
        if message.number < self._newest or message.rows.max() >= len(self._site.own_ids):
            return
        if message.number > self._newest:
            self._newest, self._parts = message.number, {}
        self._parts[int(message.rows[0])] = message

    def stands(self, below_m_s: float) -> bool:
        """Whether all of them that return have stopped."""
        if len(self._known.flown_by_others(Phase.FORMATION, Phase.HOLD)):
            return False
        rows = self._known.flown_by_others(Phase.RETURN)
        return bool((np.linalg.norm(self._known.others.velocity_m_s[rows], axis=1) < below_m_s).all())

    def returning(self) -> Returning:
        """Those that wait for a plan of the return."""
        rows, others, home_m = (
            self._known.flown_by_others(Phase.RETURN),
            self._known.others,
            self._site.home_m,
        )
        placed = np.isfinite(home_m[rows]) & np.isfinite(others.position_m[rows])
        rows = rows[placed.all(axis=1)]
        return Returning(rows, others.position_m[rows], home_m[rows], others.uncertainty_m[rows])

    def under_way(self, rows: Rows) -> tuple[Array, Mask]:
        """(j, 3) positions of these, and (j,) whether they follow a plan."""
        follows = np.isin(rows, self._known.flown_by_others(Phase.RETURN))
        return self._known.others.position_m[rows], follows

    def publish_paths(self, paths: ReturnPaths, rows: Rows, home_m: Array) -> None:
        """Send (j,) vehicles, the last of the plan, their paths home."""
        self._sender.publish_paths(paths, rows, home_m)

    def received_paths(self, after: int) -> tuple[ReturnPaths, Rows, Array] | None:
        """Paths of a later return for own vehicles: with their rows (m,) and landing places (m, 3)."""
        parts = list(self._parts.values())
        if self._newest <= after or not parts or len(parts) < parts[0].parts:
            return None
        planned = np.concatenate([part.planned for part in parts])
        paths = ReturnPaths(
            np.concatenate([part.drawn_m for part in parts]),
            np.concatenate([part.path_m for part in parts]),
            np.concatenate([part.over_s for part in parts]),
            np.concatenate([part.down_s for part in parts]),
            tuple(np.flatnonzero(~planned).tolist()),
        )
        rows, pad_m = (np.concatenate([getattr(part, name) for part in parts]) for name in ("rows", "pad_m"))
        return paths, rows, pad_m

    def led_s(self) -> float:
        """Time in the plan at the station that planned the return; NaN: not known."""
        lead = self._site.stations.get(self._site.lead.name)
        if lead is None or lead.batch is None:
            return nan
        return lead.batch.return_s + max(self._now_s() - lead.made_s, 0.0)

    def note_return(self, time_s: float) -> None:
        """Note the time in the plan of the return, for the other stations."""
        self._sender.note_return(time_s)
