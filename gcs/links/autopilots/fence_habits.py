"""How an autopilot keeps an uploaded fence of polygons. Pure."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from gcs.links.autopilots.versions.version import Release
from gcs.model.polygon_fence import PolygonFence


class FenceHabits(NamedTuple):
    """What there is room for, and when a stored fence is flown."""

    title: str  # of the autopilot
    since: Release  # earlier versions take no polygons by the mission protocol
    corners_max: Mapping[Release, int]  # by the first version that has so many
    checked_s: float  # a breach is noticed at most so much later
    loads_anew: bool = False  # what is stored may be not flown: only an upload of another fence loads it
    refuses: str = ""  # how texts begin that say that an area is stored, and not flown
    head_corners: float = 0.0  # room that the head takes, in corners
    polygon_corners: float = 0.0  # and the head of each polygon

    def why_not(self, fence: PolygonFence, possible: Sequence[Release]) -> str:
        """Why a vehicle of these versions does not take this fence, in words; empty: it does."""
        oldest, newest = min(possible), max(possible)
        if newest < self.since:  # one that may know them says itself if it does not
            return f"{self.title} {newest} takes no polygons, from {self.since} on it does"
        most = max((count for since, count in self.corners_max.items() if since <= oldest), default=0)
        needed = fence.vertex_count + self.head_corners + self.polygon_corners * len(fence.polygons)
        if needed > most:
            room = int(most - self.head_corners - self.polygon_corners * len(fence.polygons))
            return f"the fence has {fence.vertex_count} corners, {self.title} {oldest} takes {room} in all"
        return ""
