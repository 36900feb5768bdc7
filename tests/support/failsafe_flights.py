"""Questions of the failsafe tests about a flight."""

import numpy as np

from gcs.failsafe.policy import Cause
from gcs.service import ActiveFailsafe, CommandRecord
from gcs.testing.virtual_show import VirtualShow


def failsafe(show: VirtualShow, cause: Cause) -> ActiveFailsafe | None:
    """The failsafe to a cause that lasts, as displayed; None: there is none."""
    return next((each for each in show.view.failsafes if each.cause == cause.value), None)


async def reacts(show: VirtualShow, cause: Cause, limit_s: float = 30.0) -> ActiveFailsafe:
    """Wait until the failsafe is shown."""
    await show.until(lambda: failsafe(show, cause) is not None, limit_s)
    found = failsafe(show, cause)
    assert found is not None
    return found


def by_itself(show: VirtualShow) -> list[CommandRecord]:
    """Commands of the service itself, oldest first."""
    return [record for record in reversed(show.service.command_log.newest()) if record.by == "service"]


async def carried_out(show: VirtualShow, reported: ActiveFailsafe) -> CommandRecord:
    """The command of a failsafe, once it has ended for every vehicle."""
    assert reported.command_id is not None
    return await show.settled(show.service.command_log.get(reported.command_id), 150.0)


def off_pad_m(show: VirtualShow, vehicle_id: str) -> float:
    """Horizontal distance of a vehicle from its start, in m."""
    row = show.config.ids.index(vehicle_id)
    begin_m = show.track.samples[0].true_m[row]
    return float(np.hypot(*(show.true_m[row] - begin_m)[:2]))


def off_sphere_m(show: VirtualShow, *vehicle_ids: str) -> float:
    """Largest true distance from the sphere, in m."""
    rows = [show.config.ids.index(name) for name in vehicle_ids]
    assert show.view.center_m is not None
    assert show.view.radius_m is not None
    away_m = np.linalg.norm(show.true_m[rows] - np.array(show.view.center_m), axis=1)
    return float(np.abs(away_m - show.view.radius_m).max())


def nearest_m(show: VirtualShow, *vehicle_ids: str) -> float:
    """True distance between the nearest two, in m."""
    place_m = show.true_m[[show.config.ids.index(name) for name in vehicle_ids]]
    apart_m = np.linalg.norm(place_m[:, None] - place_m[None], axis=2)
    return float(apart_m[np.triu_indices(len(place_m), 1)].min())
