"""Executes fault commands: breaks links and vehicles, and repairs them when their time is over. Sans-I/O."""

import heapq
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import count
from types import MappingProxyType
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs.sim.faults import commands
from gcs.sim.faults.commands import FaultCommand, FaultCommandError, Value
from gcs.sim.fleet import Fleet
from gcs.sim.mixed import AnyFleet
from gcs.sim.vehicle.state import Stuck

Tag = TypeVar("Tag")

OVERTAKEN_S = 0.05  # delay of a reordered packet behind the others
LONGEST_GARBAGE = 280  # about a MAVLink frame


@dataclass(slots=True)
class DirectionFaults:
    """Faults of one direction; shares are of packets, from 0 to 1. The defaults are faultless."""

    silent: bool = False
    loss: float = 0.0
    corrupt: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    late: float = 0.0
    least_s: float = 0.1
    most_s: float = 10.0


class Way(Generic[Tag]):
    """One direction of a vehicle's link. A tag travels with each packet."""

    def __init__(self, random: np.random.Generator) -> None:
        self.faults = DirectionFaults()
        self._random = random
        self._queue: list[tuple[float, int, bytes, Tag]] = []
        self._order = count()
        self._last_due_s = 0.0

    def put(self, packet: bytes, tag: Tag, now_s: float) -> None:
        """Send a packet; it may never arrive, or twice, or damaged."""
        faults, chance = self.faults, self._random.random
        if faults.silent or chance() < faults.loss:
            return
        if packet and chance() < faults.corrupt:
            packet = self._damaged(packet)
        for _ in range(2 if chance() < faults.duplicate else 1):
            due_s = now_s + faults.delay_s + faults.jitter_s * chance()
            if faults.late > 0.0 and chance() < faults.late:
                due_s += faults.least_s + (faults.most_s - faults.least_s) * chance()
            elif chance() < faults.reorder:
                due_s = max(due_s, self._last_due_s) + OVERTAKEN_S
            else:
                self._last_due_s = due_s = max(due_s, self._last_due_s)
            heapq.heappush(self._queue, (due_s, next(self._order), packet, tag))

    def take(self, now_s: float) -> list[tuple[bytes, Tag]]:
        if self.faults.silent:
            self._queue.clear()
        arrived = []
        while self._queue and self._queue[0][0] <= now_s:
            _, _, packet, tag = heapq.heappop(self._queue)
            arrived.append((packet, tag))
        return arrived

    def _damaged(self, packet: bytes) -> bytes:
        damaged = bytearray(packet)
        for place in self._random.integers(0, len(packet), self._random.integers(1, 4)):
            damaged[place] ^= int(self._random.integers(1, 256))
        return bytes(damaged)


class Jammer:
    """A source of garbage at a steady rate."""

    def __init__(self, random: np.random.Generator) -> None:
        self.rate_hz = 0.0
        self._random = random
        self._reported_s: float | None = None
        self._owed = 0.0

    def take(self, now_s: float) -> list[bytes]:
        passed_s = 0.0 if self._reported_s is None else now_s - self._reported_s
        self._reported_s = now_s
        self._owed += passed_s * self.rate_hz
        due = int(self._owed)
        self._owed -= due
        sizes = self._random.integers(1, LONGEST_GARBAGE, due)
        return [self._random.bytes(int(size)) for size in sizes]


class Channel(Generic[Tag]):
    """A vehicle's link: both directions and a jammer."""

    def __init__(self, random: np.random.Generator) -> None:
        self.out: Way[None] = Way(random)
        self.into: Way[Tag] = Way(random)
        self.jammer = Jammer(random)

    @property
    def ways(self) -> dict[str, DirectionFaults]:
        return {"out": self.out.faults, "in": self.into.faults}


Origin: TypeAlias = Any
"""Source of a packet; only the server uses it."""

FAULT_SEED = 2
CHANGES: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "silence": ("silent",),
        "delay": ("delay_s", "jitter_s"),
        "late": ("late", "least_s", "most_s"),
        "jam": (),
    }
)
"""Fields of DirectionFaults that a fault changes; the others change the one of their name."""

REPORTED = frozenset({"accuracy", "fix", "sensor", "wrong-time", "report-freeze", "report-velocity"})
HEALED = REPORTED | {"barometer", "gps-jump", "gps-freeze", "wind"}
"""Faults that end with what a column held before."""


class FaultInjector:
    """The faults of a fleet's vehicles; rows are the fleet's."""

    def __init__(self, fleet: AnyFleet) -> None:
        """Begin without faults. Random numbers follow from the fleet's seed and each vehicle's index."""
        self._fleet = fleet
        self.broken: dict[int, Channel[Origin]] = {}  # the links with faults, by row
        self._ends: dict[tuple[int, str], float] = {}
        self._charge: dict[int, float] = {}  # of batteries before their fault, by row
        self.changes = 0
        """How often the set of links with faults has changed."""

    def obey(self, line: str | bytes) -> str:
        """Execute one line of JSON.

        Returns: a line of JSON, with "ok", and with "error" where nothing changed.
        """
        try:
            command = commands.parse(line)
            rows = self._rows(command)
        except FaultCommandError as error:
            return json.dumps({"ok": False, "error": str(error)})
        unmoved = [row for row in rows if not self._apply(row, command)]
        answer: dict[str, object] = {"ok": True, "fault": command.fault, "vehicles": self._numbers(rows)}
        if unmoved:
            answer["unmoved"] = self._numbers(unmoved)
        return json.dumps(answer)

    def pass_time(self) -> None:
        if not self._ends:
            return
        for (row, fault), end_s in list(self._ends.items()):
            if self._fleet.time_s >= end_s:
                self._end(row, fault)

    def _rows(self, command: FaultCommand) -> list[int]:
        first, count = self._fleet.settings.first, self._fleet.settings.count
        if command.vehicles is None:
            return list(range(count))
        for number in command.vehicles:
            if not first < number <= first + count:
                raise FaultCommandError(f"vehicle {number}: there are {first + 1} to {first + count}")
        return [number - first - 1 for number in command.vehicles]

    def _numbers(self, rows: list[int]) -> list[int]:
        return [row + self._fleet.settings.first + 1 for row in rows]

    def _apply(self, row: int, command: FaultCommand) -> bool:
        """Returns: whether it took effect; False where the vehicle's own settings prevent it."""
        fault, values = command.fault, command.values
        if fault == "none":
            self._fix(row)
            return True
        took = (
            self._break_link(row, fault, values)
            if fault in commands.LINK_FAULTS
            else self._break_vehicle(row, command)
        )
        if took and command.for_s < math.inf:
            self._ends[row, fault] = self._fleet.time_s + command.for_s
        else:
            self._ends.pop((row, fault), None)
        return took

    def _break_link(self, row: int, fault: str, values: Mapping[str, Value]) -> bool:
        channel = self.broken.get(row)
        if channel is None:
            settings = self._fleet.settings
            seeds = np.random.SeedSequence(settings.seed, spawn_key=(settings.first + row, FAULT_SEED))
            channel = self.broken[row] = Channel(np.random.default_rng(seeds))
            self.changes += 1
        if fault == "jam":
            channel.jammer.rate_hz = float(values["rate_hz"])
            return True
        for way, faults in channel.ways.items():
            if values["way"] in {"both", way}:
                _set(faults, fault, values)
        return True

    def _break_vehicle(self, row: int, command: FaultCommand) -> bool:
        values, fault = command.values, command.fault
        fleet, at = self._fleet.part_of(row)
        state = fleet.state
        if fault in {"gps-jump", "position-reset"}:
            state.offset_m[at] += _vector(values, "m")
            state.reset_counter[at] += np.uint8(fault == "position-reset")
        elif fault == "barometer":
            state.barometer_m[at] = float(values["up_m"])
        elif fault == "gps-freeze":
            state.frozen_m[at] = fleet.sensors.estimate_m[at]
        elif fault in REPORTED:
            _report(fleet, at, fault, values)
        elif fault == "wind":
            fleet.wind_m_s[at] = _vector(values, "m_s")
        elif fault == "clock-jump":
            state.clock_offset_s[at] += float(values["by_s"])
        elif fault == "battery":
            self._charge.setdefault(row, float(state.remaining[at]))
            state.remaining[at] = float(values["remaining"])
        elif fault == "stuck-mode":
            fleet.autopilots[at].commander.stuck = Stuck(values["answer"])
        elif fault == "reboot":
            self._reboot(row, values)
        else:
            return self._of_autopilot(row, command)
        return True

    def _of_autopilot(self, row: int, command: FaultCommand) -> bool:
        """What the autopilot itself does; False where it does not."""
        fleet, at = self._fleet.part_of(row)
        commander = fleet.autopilots[at].commander
        if command.fault == "termination":
            return commander.terminate()
        if command.fault == "compass":
            return commander.doubt_compass()
        if command.fault == "transponder":
            return fleet.autopilots[at].break_transponder(str(command.values["how"]))
        return self._take_over(row, command.values)

    def _reboot(self, row: int, values: Mapping[str, Value]) -> None:
        """Silence the link for off_s. In the air PX4's motors stop; with go-on only the flight continues."""
        off_s = float(values["off_s"])
        fleet, at = self._fleet.part_of(row)
        if values["motors"] == "stop":
            fleet.reboot(at, off_s=off_s)
        else:
            fleet.restart_link(at, off_s=off_s)
        if off_s > 0.0:
            self._break_link(row, "silence", {"way": "both"})
            self._ends[row, "silence"] = self._fleet.time_s + off_s

    def _take_over(self, row: int, values: Mapping[str, Value]) -> bool:
        """Take over: by the mode switch always; by moving the sticks only where its settings allow it."""
        fleet, at = self._fleet.part_of(row)
        by_sticks = values["by"] == "sticks"
        if not fleet.autopilots[at].commander.take_over(str(values["mode"]), by_sticks=by_sticks):
            return False
        fleet.state.piloted[at] = True
        fleet.state.stick_m_s[at] = _vector(values, "m_s")
        return True

    def _fix(self, row: int) -> None:
        if self.broken.pop(row, None) is not None:
            self.changes += 1
        for fault in commands.VEHICLE_FAULTS:
            self._end(row, fault)
        fleet, at = self._fleet.part_of(row)
        fleet.state.remaining[at] = self._charge.pop(row, fleet.state.remaining[at])
        for key in [key for key in self._ends if key[0] == row]:
            del self._ends[key]

    def _end(self, row: int, fault: str) -> None:
        self._ends.pop((row, fault), None)
        channel = self.broken.get(row)
        if channel is not None and fault in commands.LINK_FAULTS:
            channel.jammer.rate_hz *= fault != "jam"
            for faults in channel.ways.values():
                _set(faults, fault, asdict(DirectionFaults()))
        fleet, at = self._fleet.part_of(row)
        for column, healthy in _healthy(fleet, fault):
            column[at] = healthy
        if fault == "stuck-mode":
            fleet.autopilots[at].commander.stuck = Stuck.NO
        elif fault == "transponder":
            fleet.autopilots[at].break_transponder("none")
        elif fault == "pilot":
            fleet.autopilots[at].commander.release()
            fleet.state.piloted[at], fleet.state.stick_m_s[at] = False, 0.0


def _healthy(fleet: Fleet, fault: str) -> Sequence[tuple[NDArray[Any], object]]:
    """The columns that a fault changes, in the order of its values, and what they hold without it."""
    state = fleet.state
    if fault not in HEALED:
        return ()
    receiver = fleet.sensed_by
    fresh = type(state)(1, 0.0)
    healthy: Mapping[str, Sequence[tuple[NDArray[Any], object]]] = {
        "gps-jump": [(state.offset_m, 0.0)],
        "barometer": [(state.barometer_m, 0.0)],
        "gps-freeze": [(state.frozen_m, np.nan)],
        "report-freeze": [(state.repeated_m, np.nan)],
        "report-velocity": [(state.velocity_times, 1.0)],
        "accuracy": [
            (state.horizontal_accuracy_m, receiver.horizontal_m),
            (state.vertical_accuracy_m, receiver.vertical_m),
            (state.hdop, fresh.hdop[0]),
            (state.vdop, fresh.vdop[0]),
        ],
        "fix": [(state.fix_type, receiver.fix_type)],
        "sensor": [(state.unhealthy_sensors, 0)],
        "wrong-time": [(state.unix_ahead_s, 0.0)],
        "wind": [(fleet.wind_m_s, fleet.settings.wind_m_s)],
    }
    return healthy[fault]


def _report(fleet: Fleet, row: int, fault: str, values: Mapping[str, Value]) -> None:
    """Make a vehicle report these values of its receiver, sensors, clock or motion."""
    state = fleet.state
    if fault == "accuracy":
        for (column, _), value in zip(_healthy(fleet, fault), values.values(), strict=True):
            if not math.isnan(float(value)):
                column[row] = float(value)
    elif fault == "fix":
        state.fix_type[row] = commands.FIXES[str(values["type"])]
    elif fault == "sensor":
        state.unhealthy_sensors[row] |= commands.SENSORS[str(values["which"])]
    elif fault == "report-freeze":
        state.repeated_m[row] = fleet.sensors.estimate_m[row]
        state.repeated_m_s[row] = fleet.sensors.velocity_m_s[row]
    elif fault == "report-velocity":
        state.velocity_times[row] = float(values["times"])
    else:
        state.unix_ahead_s[row] = float(values["ahead_s"])


def _set(faults: DirectionFaults, fault: str, values: Mapping[str, float | str]) -> None:
    """Set what a fault changes, by the same names in `values`; the share of its packets, if named so."""
    for name in CHANGES.get(fault, (fault,)):
        setattr(faults, name, values[name] if name in values else values.get("share", True))


def _vector(values: Mapping[str, Value], unit: str) -> list[float]:
    return [float(values[f"{way}_{unit}"]) for way in ("north", "east", "down")]
