"""A fleet in which vehicles with PX4 and with ArduPilot alternate: one fleet of each, under one clock."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from gcs.sim.autopilots.firmware import Sent
from gcs.sim.fleet import STEP_S, Fleet
from gcs.sim.settings import Autopilot, Settings
from gcs.sim.vehicle import versions
from gcs.sim.vehicle.dynamics import Array

KINDS: tuple[Autopilot, ...] = ("px4", "ardupilot")
"""Vehicle i, from 0, has the autopilot i % 2."""


class MixedFleet:
    """Vehicles of both kinds; row i is row i // 2 of `parts[i % 2]`, vehicle `settings.first` + i.

    Attributes:
        parts: the fleets of one kind; each has the whole place, time and wind.
        autopilots: by row.
        receiver: passes datagrams to both.
    """

    def __init__(
        self, settings: Settings, *, start_s: float, unix_at_start_s: float = 0.0, step_s: float = STEP_S
    ) -> None:
        """See `Fleet`. A parameter applies to the vehicles with an autopilot that has it."""
        self.settings = settings
        count, first = settings.count, settings.first
        self.parts = [
            Fleet(
                replace(
                    _settings_of(KINDS[(first + offset) % len(KINDS)], settings),
                    first=first + offset,
                    count=(count - offset + 1) // len(KINDS),
                    every=len(KINDS),
                ),
                start_s=start_s,
                unix_at_start_s=unix_at_start_s,
                step_s=step_s,
            )
            for offset in range(min(count, len(KINDS)))
        ]
        self.receiver = MixedReceiver(self)
        self.autopilots = [fleet.autopilots[at] for fleet, at in map(self.part_of, range(count))]
        self.step_s = step_s
        self.geodetic = self.parts[0].geodetic

    @property
    def time_s(self) -> float:
        return self.parts[0].time_s

    @property
    def unix_ahead_s(self) -> float:
        return self.parts[0].unix_ahead_s

    @property
    def position_m(self) -> Array:
        """(n, 3) true positions by row, in the fleet's common NED."""
        return self._by_row([part.position_m for part in self.parts])

    @property
    def velocity_m_s(self) -> Array:
        """(n, 3) true velocities by row."""
        return self._by_row([part.velocity_m_s for part in self.parts])

    def part_of(self, row: int) -> tuple[Fleet, int]:
        """See `Fleet.part_of`."""
        return self.parts[row % len(self.parts)], row // len(self.parts)

    def skip(self, skipped_s: float) -> None:
        """See `Fleet.skip`."""
        for part in self.parts:
            part.skip(skipped_s)

    def step(self) -> None:
        for part in self.parts:
            part.step()

    def take_frames(self, *, streams: bool = True) -> Sent:
        """See `Fleet.take_frames`."""
        return {
            row * len(self.parts) + offset: frames
            for offset, part in enumerate(self.parts)
            for row, frames in part.take_frames(streams=streams).items()
        }

    def _by_row(self, values: Sequence[Array]) -> Array:
        whole = np.empty((self.settings.count, 3))
        for offset, part in enumerate(values):
            whole[offset :: len(values)] = part
        return whole


class MixedReceiver:
    """Passes datagrams to the receivers of both kinds; each ignores vehicles of the other. See `Receiver`."""

    def __init__(self, fleet: MixedFleet) -> None:
        """At first every vehicle alone is circle number `row`."""
        self._fleet = fleet
        self._circles: list[list[int]] = []  # of each part, by circle
        for row in range(fleet.settings.count):
            self.circle([row])

    def circle(self, rows: Sequence[int]) -> int:
        """Let these vehicles share a socket. Returns: the circle's number."""
        self._circles.append([part.receiver.circle(own) for part, own in self._split(rows)])
        return len(self._circles) - 1

    def regroup(self, circle: int, rows: Sequence[int]) -> None:
        """Let exactly these vehicles receive from the socket."""
        for (part, own), number in zip(self._split(rows), self._circles[circle], strict=True):
            part.receiver.regroup(number, own)

    def receive(self, batch: Sequence[tuple[int, bytes]]) -> list[bool]:
        """Process (circle, datagram)s. Returns: for each whether it contains a valid frame."""
        valid = [False] * len(batch)
        for place, part in enumerate(self._fleet.parts):
            own = [(self._circles[circle][place], datagram) for circle, datagram in batch]
            valid = [before or now for before, now in zip(valid, part.receiver.receive(own), strict=True)]
        return valid

    def _split(self, rows: Sequence[int]) -> list[tuple[Fleet, list[int]]]:
        kinds = len(self._fleet.parts)
        return [
            (part, [row // kinds for row in rows if row % kinds == offset])
            for offset, part in enumerate(self._fleet.parts)
        ]


def _settings_of(kind: Autopilot, settings: Settings) -> Settings:
    """Those of the vehicles with that autopilot: its version, and the parameters that this version knows."""
    version = versions.part_for(kind, settings.version)
    listed = versions.find(kind, version).parameters
    parameters = {name: value for name, value in settings.parameters.items() if listed.knows(name)}
    return replace(settings, autopilot=kind, version=version, parameters=parameters)


AnyFleet: TypeAlias = Fleet | MixedFleet


def fleet_of(
    settings: Settings, *, start_s: float, unix_at_start_s: float = 0.0, step_s: float = STEP_S
) -> AnyFleet:
    """The fleet with these settings, of one kind or mixed; see `Fleet`."""
    make = MixedFleet if settings.autopilot == "mixed" else Fleet
    return make(settings, start_s=start_s, unix_at_start_s=unix_at_start_s, step_s=step_s)
