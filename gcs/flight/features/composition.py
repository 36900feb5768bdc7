"""The features of a flight. A new one is its class, and its name here."""

import asyncio
from collections.abc import Callable
from functools import partial

import numpy as np

from gcs.flight.features.corrections import Corrections
from gcs.flight.features.fences import FenceUploads
from gcs.flight.features.laws.guard import LawGuard
from gcs.flight.features.lights import Lights
from gcs.flight.features.remote_id import RemoteId
from gcs.flight.features.tak import TakTracks
from gcs.flight.features.targets import Targets
from gcs.flight.features.traffic import OtherTraffic
from gcs.flight.state.feature import Feature
from gcs.flight.state.flight import FLIES, Flight
from gcs.model.lifecycle import AIRBORNE
from gcs.model.state import Mask


def features_of(
    flight: Flight,
    targets: Targets,
    guard: LawGuard,
    unix_minus_loop_s: Callable[[], float],
    group: asyncio.TaskGroup,
) -> list[Feature]:
    """Those of this flight, in the order in which they send."""
    newest, links, config = flight.newest, flight.links, flight.config
    return [
        Corrections(config.rtk, links, newest.state.time_s),
        flight.outside_clock,
        targets,
        OtherTraffic(
            config.traffic,
            config.frame,
            newest,
            partial(_flown, flight),
            config.control.safety.fence.height_max_m,
            frozenset(vehicle.system_id for vehicle in flight.vehicles.values()),
            config.own_tracks,
            unix_minus_loop_s,
        ),
        TakTracks(
            config,
            newest,
            flight.vehicles,
            lambda: flight.elsewhere.owned,
            lambda: flight.elsewhere.shows.leads,
            flight.unix_s,
            unix_minus_loop_s,
        ),
        FenceUploads(
            config.polygon_fence,
            group,
            newest,
            flight.vehicles,
            flight.link_of,
            lambda: flight.elsewhere.owned,
        ),
        RemoteId(
            config,
            newest,
            flight.vehicles,
            links,
            flight.seen,
            flight.closed,
            lambda: flight.elsewhere,
            flight.unix_s,
            unix_minus_loop_s,
        ),
        Lights(newest, flight.vehicles, flight.show, links, config, lambda: flight.elsewhere.owned),
        guard,
    ]


def _flown(flight: Flight) -> Mask:
    """(n,) The vehicles that fly; before a start those that may, and are within the fence's distance.

    One under a pilot counts only where no other flies: it may be anywhere.
    """
    phases = [vehicle.phase for vehicle in flight.vehicles.values()]
    for counted in (AIRBORNE, FLIES):
        flies = np.array([phase in counted for phase in phases], np.bool_)
        if flies.any():
            return flies
    place_m, most_m = flight.newest.state.position_m, flight.in_force.control.safety.fence.distance_max_m
    meant = np.array([name not in flight.excluded for name in flight.vehicles], np.bool_)
    return np.asarray(meant & (np.hypot(place_m[:, 0], place_m[:, 1]) <= most_m))
