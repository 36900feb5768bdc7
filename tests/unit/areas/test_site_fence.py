"""A site in the show frame: the fence has its areas and heights."""

import numpy as np
import pytest

from gcs.areas.site import AreaKind, FlightSite
from gcs.areas.site_fence import fence_within
from gcs.model.errors import SiteError
from gcs.model.frames import ShowFrame
from gcs.safety.fenced_areas import AREAS_MAX, FencedArea, beyond_m
from gcs.safety.walls import Fence
from tests.support.fields import AUDIENCE, ELL, ORIGIN, area, field, geography


@pytest.mark.parametrize("heading_deg", [0.0, 117.0, 300.0])
def test_areas_lie_where_they_were_drawn(heading_deg: float) -> None:
    """North and east become x along the heading and y to its right, to a centimetre."""
    frame = ShowFrame(47.397742, 8.545594, 488.0, heading_deg)
    fence = fence_within(field(), frame, Fence())
    inside, outside = fence.areas
    assert (inside.inside, outside.inside) == (True, False)
    for fenced, ring in ((inside, ELL), (outside, AUDIENCE)):
        north = np.array([(x, y, 0.0) for x, y in ring], float)
        turned = frame.from_ned(north)[:, :2]
        away_m = np.linalg.norm(np.array(fenced.corners_m)[:, None] - turned, axis=2)
        assert away_m.min(axis=0).max() < 0.02
    gate = frame.from_ned(np.array([[0.0, 0.0, 0.0], [60.0, 60.0, 0.0], [130.0, 130.0, 0.0]]))[:, :2]
    assert (beyond_m(fence.areas, gate) > 0.0).tolist() == [False, True, True]


def test_heights_only_narrow_the_fence() -> None:
    fence = fence_within(field(top_m=45.0), ORIGIN, Fence(height_min_m=3.0, height_max_m=100.0))
    assert (fence.height_min_m, fence.height_max_m) == (3.0, 45.0)
    assert fence_within(field(top_m=45.0), ORIGIN, Fence(height_max_m=30.0)).height_max_m == 30.0
    with pytest.raises(SiteError, match="ends at 45 m, the fence begins at 50 m: no height is left"):
        fence_within(field(top_m=45.0), ORIGIN, Fence(height_min_m=50.0))


def test_areas_of_the_fence_stay() -> None:
    own = FencedArea(corners_m=((0.0, 0.0), (0.0, 5.0), (5.0, 5.0)), inside=False)
    assert fence_within(field(), ORIGIN, Fence(areas=(own,))).areas[2] == own


def test_a_site_elsewhere_is_refused() -> None:
    north = ShowFrame(47.9, 8.545594, 488.0)
    with pytest.raises(SiteError, match="it is 56 km from the origin of the show frame: it is another field"):
        fence_within(field(), north, Fence())
    swapped = ShowFrame(8.545594, 47.397742, 488.0)
    with pytest.raises(SiteError, match="latitude and longitude of one of them are swapped; at most 10 km"):
        fence_within(field(), swapped, Fence())
    beyond = ShowFrame(-33.8, 151.2, 20.0)
    with pytest.raises(SiteError, match="another field's site"):
        fence_within(field(), beyond, Fence())


def test_more_areas_than_the_filter_keeps_are_refused() -> None:
    own = FencedArea(corners_m=((0.0, 0.0), (0.0, 5.0), (5.0, 5.0)), inside=False)
    trees = [area(AreaKind.NO_FLY, ((50, y), (50, y + 6), (60, y + 6))) for y in (-30, -20)]
    site = FlightSite("a", (geography(), *trees))
    fence = Fence(areas=(own,) * (AREAS_MAX - 2))
    with pytest.raises(SiteError, match=rf"3 areas and {AREAS_MAX - 2} of the fence .* at most {AREAS_MAX}"):
        fence_within(site, ORIGIN, fence)
