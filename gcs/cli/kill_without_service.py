"""A kill without the service: its record has the addresses, and this process sends the commands.

It binds the service's ports if they are free, so that routers and NATs keep passing the traffic. A service
that hangs may still hold them; then the commands are sent from any port.
"""

import argparse
import getpass
import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import ValidationError

from gcs.cli.output import note
from gcs.config.schema import Config
from gcs.config.sections import LinkSettings
from gcs.config.setting_errors import explained
from gcs.links.endpoints.ports import Datagrams, host_number, source_of
from gcs.links.endpoints.streams import LinkPorts
from gcs.links.settings import station_id
from gcs.links.signing import Signing
from gcs.mavlink.codec import ARM_DISARM, AUTOPILOT_COMPONENT, encode, find, frame, joined, kill_message
from gcs.mavlink.framing import COMMAND_ACK, COMMAND_LONG, HEARTBEAT, Frame, Judgement, is_armed
from gcs.mavlink.kernels import DATAGRAM
from gcs.model.errors import ConfigError, InvalidError, LinkError, RefusedError, UnknownError
from gcs.model.state import VehicleId
from gcs.recording.audit import OfflineAudit
from gcs.recording.audit_reader import KnownVehicle, LastKnown, last_known
from gcs.service import Outcome, VehicleOutcome

CODE_S: Final = 30.0
"""A code is valid for at least this long, and at most twice as long."""


def kill_by_record(
    arguments: argparse.Namespace, is_confirmed: Callable[[Sequence[str], str, float], bool]
) -> dict[str, tuple[str, str]] | None:
    """Kill vehicles with the addresses and the configuration of the service's record.

    Returns: outcome and reason of each vehicle; None when `is_confirmed` did not confirm vehicles, code and
        the code's time. Raises: GcsError when nothing was sent.
    """
    known = last_known(Path(arguments.record))
    if known.session is None:
        raise ConfigError(f"{arguments.record}: no session is in this record")
    try:
        config = Config.model_validate(dict(known.session.config))
    except ValidationError as error:
        text = f"{arguments.record}: session {known.session.id}"
        raise explained(error, text, Config, None) from None
    chosen = _chosen(known, arguments)
    names = [vehicle.id for vehicle in chosen]
    codes = [_code(known, chosen, time.time() - age_s) for age_s in (0.0, CODE_S)]
    if arguments.confirm is None:
        if not is_confirmed(names, codes[0], CODE_S):
            return None
    elif arguments.confirm not in codes:
        raise RefusedError(f"{arguments.confirm!r} does not confirm {', '.join(names)}: leave --confirm out")
    user = f"gcs kill ({getpass.getuser()})"
    with OfflineAudit(Path(arguments.record), known, user) as record:
        command_id = record.opened("kill", names)
        outcomes = direct_kill(config, chosen)
        for name, part in outcomes.items():
            record.closed(command_id, name, part)
    if record.problem:
        note(f"not recorded: {record.problem}", as_json=arguments.json)
    return {name: (part.outcome, part.reason) for name, part in outcomes.items()}


def _chosen(known: LastKnown, arguments: argparse.Namespace) -> list[KnownVehicle]:
    if arguments.all:
        received = [one for one in known.vehicles.values() if one.host is not None]
        if not received:
            raise RefusedError(f"{arguments.record}: no vehicle was ever received")
        return received
    if not arguments.vehicles:
        raise InvalidError(
            "vehicles", "none", "names, or --all: without the service a code does not know them"
        )
    unknown = [name for name in arguments.vehicles if name not in known.vehicles]
    if unknown:
        there = ", ".join(known.vehicles) or "none"
        raise UnknownError(f"{arguments.record}: no such vehicle: {', '.join(unknown)}; there are {there}")
    return [known.vehicles[name] for name in dict.fromkeys(arguments.vehicles)]


def _code(known: LastKnown, chosen: Sequence[KnownVehicle], unix_s: float) -> str:
    """Make the code, a hash of vehicles and time, so that nothing is stored between the two steps."""
    session = "" if known.session is None else known.session.id
    hashed = [session, str(int(unix_s / CODE_S)), *sorted(one.id for one in chosen)]
    return hashlib.sha256("\0".join(hashed).encode()).hexdigest()[:6]


WITHIN_S: Final = 5.0
"""Time limit: heartbeats come once a second, and opening a TCP connection or a radio may take a few."""

REPEAT_S: Final = 0.1
LOOK_S: Final = 0.01


@dataclass(slots=True)
class _Target:
    """One vehicle to be killed, and its replies."""

    vehicle: KnownVehicle
    sent: int = 0
    received_at: int | None = None  # source of its newest frame
    acknowledged: int | None = None  # the newest MAV_RESULT
    armed: bool | None = None  # from heartbeats after the first command
    failure: str = ""  # why the last command could not be sent


@dataclass(slots=True)
class _KillLink:
    """The ports of one link, and its vehicles."""

    settings: LinkSettings
    ports: LinkPorts
    signing: Signing | None
    station_id: int
    targets: dict[int, _Target]  # by system id
    problem: str = ""
    sequence: int = 0

    def open(self) -> None:
        """Open the configured ports; for a UDP port in use, any free one."""
        self.ports.open()
        if self.ports.problems:
            self.problem = f"{self.ports.problems[-1]}: does a service hold it?"
        if self.signing is not None:
            try:
                self.signing.open()
            except LinkError as error:  # frames are still signed, with timestamps from the present time
                self.problem = str(error)

    def close(self) -> None:
        self.ports.close()
        if self.signing is not None:
            self.signing.close()

    def send(self) -> None:
        for system_id, target in self.targets.items():
            if target.armed is False:
                continue
            sequence = np.array([self.sequence % 256], np.uint8)
            frames = encode(COMMAND_LONG, kill_message(system_id), sequence, system_id=self.station_id)
            self.sequence += 1
            raw: bytes | None = frames.data[0, : frames.length[0]].tobytes()
            if self.signing is not None and raw is not None:
                raw = self.signing.signer.sign(raw)
            sources = self._sources(target)
            if raw is None or not sources:
                continue
            data, length = joined([raw] * len(sources))
            left = self.ports.send(data, length, np.array(sources, np.int64))
            target.sent += int(left.sum())
            for source in np.array(sources)[~left].tolist():
                target.failure = f"{self.ports.address(source)}: {self.ports.failures.get(source, 'no room')}"

    def _sources(self, target: _Target) -> list[int]:
        """Return the vehicle's address; before it is received, all standing and recorded addresses."""
        if target.received_at is not None:
            return [target.received_at]
        standing = [*self.ports.standing()]
        known = target.vehicle
        if not known.host or not known.port or not self.ports.udp_count:
            return standing
        ids = [one.id for one in self.settings.fleet]
        port = ids.index(known.id) if known.id in ids and self.ports.udp_count == len(ids) else 0
        return [*standing, source_of(host_number(known.host), known.port, port)]

    def receive(self) -> None:
        self.ports.receive(self._take)
        for source in self.ports.gone():
            for target in self.targets.values():
                if target.received_at == source:
                    target.received_at = None

    def _take(self, arrived: Datagrams) -> None:
        for found in find(arrived.data, arrived.start, arrived.length).frames.tolist():
            received = frame(arrived.data, found)
            target = self.targets.get(received.system_id)
            if target is None or received.component_id != AUTOPILOT_COMPONENT:
                continue
            if self.signing is not None and self.signing.signer.judge(received) is not Judgement.GOOD:
                continue
            target.received_at = int(arrived.source[found[DATAGRAM]])
            if target.sent:
                _note(target, received)


def _note(target: _Target, received: Frame) -> None:
    if received.message_id == HEARTBEAT:
        target.armed = is_armed(received)
    elif received.message_id == COMMAND_ACK:
        command, result = int.from_bytes(received.payload[:2], "little"), (*received.payload[2:3], 0)[0]
        if command == ARM_DISARM:
            target.acknowledged = result


def direct_kill(
    config: Config, vehicles: Sequence[KnownVehicle], *, within_s: float = WITHIN_S
) -> Mapping[VehicleId, VehicleOutcome]:
    """Repeat the command to all vehicles until each reports that its motors are off, or the time is over.

    `config` is that of the session that controlled them last.

    Raises: ConfigError when a signing key cannot be read, before anything is sent.
    """
    lines = _lines(config, vehicles)
    targets = [target for line in lines for target in line.targets.values()]
    try:
        for line in lines:
            line.open()
        until_s, due_s = time.monotonic() + within_s, 0.0
        while time.monotonic() < until_s and not all(target.armed is False for target in targets):
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + REPEAT_S
                for line in lines:
                    line.send()
            time.sleep(LOOK_S)
            for line in lines:
                line.receive()
    finally:
        for line in lines:
            line.close()
    problems = {target.vehicle.id: line.problem for line in lines for target in line.targets.values()}
    reported = {target.vehicle.id: _outcome(target, problems[target.vehicle.id]) for target in targets}
    nowhere = VehicleOutcome(Outcome.FAILED, "its link is not in the configuration of the record")
    return {vehicle.id: reported.get(vehicle.id, nowhere) for vehicle in vehicles}


def _lines(config: Config, vehicles: Sequence[KnownVehicle]) -> list[_KillLink]:
    lines = []
    for link in config.links:
        targets = {one.system_id: _Target(one) for one in vehicles if one.link == link.name}
        if not targets:
            continue
        ports = LinkPorts(link.name, link.places, time.monotonic, replace_busy=True)
        signing = None if link.signing is None else Signing(link.signing.key_file, link.signing.link_id)
        own = station_id([one.system_id for one in link.fleet])
        lines.append(_KillLink(link, ports, signing, own, targets))
    return lines


def _outcome(target: _Target, problem: str) -> VehicleOutcome:
    if target.armed is False:
        return VehicleOutcome(Outcome.DONE, "its motors are off")
    if not target.sent:
        why = target.failure or problem or "the record has no address of it"
        return VehicleOutcome(Outcome.FAILED, f"nothing could be sent: {why}")
    where = f"{target.sent} commands sent"
    if target.acknowledged is not None:
        reply = "accepted" if target.acknowledged == 0 else f"refused ({target.acknowledged})"
        return VehicleOutcome(Outcome.FAILED, f"{where}, {reply}, but its motors were not seen to stop")
    silent = "" if target.received_at is None else "; it reports that its motors run"
    held = f"; {problem}" if problem else ""
    return VehicleOutcome(Outcome.FAILED, f"{where}, no answer{silent}{held}")
