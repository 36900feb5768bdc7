"""Rules across the values of a configuration: fleet, radius, fence. Pure."""

from collections.abc import Iterator, Sequence
from math import isfinite

from gcs.config.setting_errors import Misfit
from gcs.config.yaml_source import Loc
from gcs.formation.orbit import CLEAR_OF_FENCE_M
from gcs.planning.feasibility import smallest_formation_radius_m
from gcs.safety.filter import SafetySettings
from gcs.safety.walls import Fence


def misfits_of_fleet(
    ports: Sequence[int], counts: Sequence[int], radius_m: float, safety: SafetySettings
) -> Iterator[Misfit]:
    """Yield ports that cannot serve their vehicles, and a formation radius that is too small.

    Only configuration files are checked: a recorded configuration was flown, and is accepted unchanged.

    Args:
        ports: number of ports of each link.
        counts: number of vehicles of each link.
        radius_m: initial radius of the formation.
        safety: settings with the minimum separation.
    """
    for at, (given, count) in enumerate(zip(ports, counts, strict=True)):
        if 1 < given < count:
            text = f"1 port for all, or one for each of the {count} vehicles: {count}"
            yield _misfit(("links", at, "ports"), given, text)
    count = sum(counts)
    smallest_m = smallest_formation_radius_m(count, safety)
    if radius_m < smallest_m:
        apart_m = safety.floor.widest_m
        text = f"at least {smallest_m:.1f} m for {count} vehicles {apart_m:.1f} m apart"
        yield _misfit(("formation", "radius_m"), radius_m, text)


def fence_too_small(radius_m: float, orbit_radius_m: float, fence: Fence) -> tuple[Loc, str] | None:
    """Check whether a sphere of that radius fits between the fence's heights and inside its distance.

    Returns: None when it fits; else the key to change and the allowed value. The key is the fence's if the
        default fence would suffice, else the radius.
    """
    room_m = fence.height_max_m - fence.height_min_m
    around_m = orbit_radius_m + CLEAR_OF_FENCE_M
    greatest_m = min(room_m / 2.0, fence.distance_max_m - around_m)
    if radius_m <= greatest_m:
        return None
    usual = Fence()
    usual_m = min((usual.height_max_m - usual.height_min_m) / 2.0, usual.distance_max_m - around_m)
    if isfinite(radius_m) and (greatest_m <= 0.0 or radius_m <= usual_m):
        if 2.0 * radius_m > room_m:
            key, least_m = "height_max_m", fence.height_min_m + 2.0 * radius_m
        else:
            key, least_m = "distance_max_m", radius_m + around_m
        text = f"too small for formation.radius_m = {radius_m:g}: at least {least_m:g} m"
        return ("control", "safety", "fence", key), text
    text = (
        f"at most {greatest_m:g} m, so that it fits inside the fence ({fence.height_min_m:g} to"
        f" {fence.height_max_m:g} m high, {fence.distance_max_m:g} m from the origin)"
    )
    return ("formation", "radius_m"), text


def _misfit(loc: Loc, value: object, text: str) -> Misfit:
    return Misfit(loc, ".".join(str(part) for part in loc), str(value), text)
