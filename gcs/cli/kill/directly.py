"""A kill without the service: this process sends the commands, to wherever the vehicles may be.

Only the autopilots of the named vehicles obey, by their system ids, wherever a datagram arrives. The command
is repeated until each reports that its motors are off; a killed vehicle is not harmed by further ones.
"""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from gcs.cli.kill.plan import KillLink, KillPlan
from gcs.cli.kill.ports import Address, Port, ports_of
from gcs.model.errors import ConfigError, LinkError

WITHIN_S: Final = 5.0
"""Time limit: heartbeats come once a second, and opening a TCP connection or a radio may take a few."""

BEATS_S: Final = 1.5
"""What sends a vehicle's id sends a heartbeat within this time; before, of two one may be unheard."""

REPEAT_S: Final = 0.1
LOOK_S: Final = 0.01
RECORD_S: Final = 0.2
KILL_MAGIC: Final = 21196.0
AUTOPILOT, STATION = 1, 190  # components
ARMED: Final = 0x80
RADIOS: Final = frozenset({"RADIO_STATUS", "RADIO"})
PARSERS_MAX: Final = 1024
PLACES_MAX: Final = 8
"""Addresses that send one vehicle's id: commands go to so many of the newest; so many confirm nothing."""


class KillPart(NamedTuple):
    """Outcome of one vehicle."""

    done: bool
    reason: str


@dataclass(slots=True)
class _Target:
    """One vehicle to be killed, and its replies."""

    name: str
    system_id: int
    known: Address | None  # where it was last
    sent: int = 0
    sent_s: float = inf  # when the first command left
    at: dict[Address, Port] = field(default_factory=dict)  # from where its id was received, the newest last
    acknowledged: int | None = None  # the newest MAV_RESULT
    armed: dict[Address, bool] = field(default_factory=dict)  # from heartbeats after the first command
    armed_s: float = -inf  # when the newest of these reported running motors
    off_s: float = inf  # when the first reported that they are off
    recorded: bool = False  # the service has recorded that its motors are off
    failure: str = ""  # why the last command could not be sent

    @property
    def stopped(self) -> bool:
        """As whatever has sent its id so far reports."""
        return self.recorded or (0 < len(self.armed) < PLACES_MAX and not any(self.armed.values()))

    def listened_s(self, now_s: float) -> float:
        """How long its id has not reported running motors; two vehicles may have it, behind one radio."""
        return now_s - max(self.sent_s, self.armed_s)

    def is_settled(self, now_s: float) -> bool:
        return self.recorded or (self.stopped and self.listened_s(now_s) >= BEATS_S)

    def is_contradicted(self, now_s: float) -> bool:
        """Whether its id has reported running motors after it reported that they are off."""
        return self.armed_s > self.off_s and not self.is_settled(now_s)

    def believes(self, at: Address, *, is_stream: bool) -> bool:
        """Whether its heartbeats from there count: anybody may send them from another host than its last."""
        return is_stream or self.known is None or at[0] == self.known[0]


@dataclass(slots=True)
class _Line:
    """The ports of one link, and its vehicles."""

    link: KillLink
    ports: list[Port]
    targets: dict[int, _Target]  # by system id
    signing: mavlink.MAVLinkSigning
    packer: Any = field(init=False)
    parsers: dict[tuple[int, Address], Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.packer = self._codec()

    def open(self) -> None:
        for port in self.ports:
            port.open()

    def close(self) -> None:
        for port in self.ports:
            port.close()
        if self.link.key_file is not None:
            from gcs.links.signing_key import reserve, time_file  # noqa: PLC0415 (numpy, of its package)

            with suppress(OSError):  # the next service then begins with the present time
                reserve(time_file(self.link.key_file, self.link.link_id), self.signing.timestamp)

    def _codec(self) -> Any:
        made = mavlink.MAVLink(None, srcSystem=self.link.station_id, srcComponent=STATION)
        made.robust_parsing = True
        made.signing = self.signing
        return made

    def send(self, now_s: float) -> None:
        for target in self.targets.values():
            if target.is_settled(now_s):
                continue
            command = mavlink.MAVLink_command_long_message(
                target.system_id,
                AUTOPILOT,
                mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
                *(0, 0.0, KILL_MAGIC, 0.0, 0.0, 0.0, 0.0, 0.0),
            )
            data = command.pack(self.packer)
            self.packer.seq = (self.packer.seq + 1) % 256
            for port, to in self._places(target):
                try:
                    port.send(data, to)
                    target.sent += 1
                    target.sent_s = min(target.sent_s, now_s)
                except OSError as error:
                    target.failure = f"{to[0]}: {error.strerror or error}"

    def _places(self, target: _Target) -> list[tuple[Port, Address]]:
        """Where it may be: far ends of its ports, its last known address, and where it was received."""
        ports, ids = self.ports, [*self.link.system_ids]
        udp = [port for port in ports if not port.is_stream]
        if len(udp) == len(ids) > 1:  # one for each vehicle
            udp = [udp[ids.index(target.name)]]
            ports = [*udp, *(port for port in ports if port.is_stream)]
        places = [(port, to) for port in ports for to in port.standing()]
        if udp and target.known is not None and target.known[1]:
            places.append((udp[0], target.known))
        return [*places, *((port, at) for at, port in target.at.items() if (port, at) not in places)]

    def receive(self) -> None:
        for number, port in enumerate(self.ports):
            for data, at in port.receive():
                for message in self._parser(number, at).parse_buffer(data) or ():
                    self._take(message, port, at)

    def _parser(self, number: int, at: Address) -> Any:
        if len(self.parsers) >= PARSERS_MAX:
            self.parsers.clear()
        return self.parsers.setdefault((number, at), self._codec())

    def _take(self, message: Any, port: Port, at: Address) -> None:
        target = self.targets.get(message.get_srcSystem())
        if target is None or message.get_srcComponent() != AUTOPILOT or message.get_type() == "BAD_DATA":
            return
        kind = message.get_type()
        is_beat = kind == "HEARTBEAT"
        declared = message.autopilot if is_beat else None
        if kind in RADIOS or declared == mavlink.MAV_AUTOPILOT_INVALID:
            return  # not its autopilot's, whatever number it has
        target.at.pop(at, None)
        target.at[at] = port
        while len(target.at) > PLACES_MAX:
            del target.at[next(iter(target.at))]
        if not target.sent or not target.believes(at, is_stream=port.is_stream):
            return
        if is_beat and (at in target.armed or len(target.armed) < PLACES_MAX):
            target.armed[at] = bool(message.base_mode & ARMED)
            if target.armed[at]:
                target.armed_s = time.monotonic()
            else:
                target.off_s = min(target.off_s, time.monotonic())
        elif kind == "COMMAND_ACK" and message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            ours = message.target_system in (0, self.link.station_id)
            target.acknowledged = message.result if ours else target.acknowledged

    def outcome(self, target: _Target) -> KillPart:
        if target.recorded:
            return KillPart(True, "its motors are off, as the service recorded")
        now_s = time.monotonic()
        if target.stopped and not target.is_contradicted(now_s):
            listened_s = target.listened_s(now_s)
            short = f", as reported for {listened_s:.1f} s: look at it" if listened_s < BEATS_S else ""
            return KillPart(True, f"its motors are off{short}")
        problem = next((port.problem for port in self.ports if port.problem), "")
        if not target.sent:
            return KillPart(
                False, f"nothing could be sent: {target.failure or problem or 'its address is unknown'}"
            )
        where = f"{target.sent} commands sent"
        if target.acknowledged is not None:
            reply = "accepted" if target.acknowledged == 0 else f"refused ({target.acknowledged})"
            return KillPart(False, f"{where}, {reply}, but its motors were not seen to stop")
        if target.armed:
            return KillPart(False, f"{where}, but it reports that its motors run")
        if target.known is not None and (others := {host for host, _ in target.at} - {target.known[0]}):
            beside = f"its id is sent from {', '.join(sorted(others))}, and it was at {target.known[0]}"
            return KillPart(False, f"{where}; {beside}: look at the vehicle")
        held = f" ({problem})" if problem else ""
        return KillPart(False, f"{where}; no answer arrives here{held}: look at the vehicle")


def kill_directly(plan: KillPlan, names: Sequence[str], within_s: float = WITHIN_S) -> Mapping[str, KillPart]:
    """Repeat the command to all vehicles until each is known to have stopped, or the time is over.

    Raises: ConfigError when nothing can be sent to any of them, because of a signing key for instance.
    """
    lines, problems = _lines(plan, names)
    targets = [target for line in lines for target in line.targets.values()]
    try:
        for line in lines:
            line.open()
        began_s, began_unix_s = time.monotonic(), time.time()
        until_s, due_s, record_due_s = began_s + within_s, 0.0, began_s + RECORD_S
        while (now_s := time.monotonic()) < until_s and not all(each.is_settled(now_s) for each in targets):
            if now_s >= due_s:
                due_s = now_s + REPEAT_S
                for line in lines:
                    line.send(now_s)
            if now_s >= record_due_s:
                stopped = plan.stopped_since(began_unix_s)
                record_due_s = now_s + RECORD_S
                for target in targets:
                    target.recorded = target.name in stopped
            time.sleep(LOOK_S)
            for line in lines:
                line.receive()
    finally:
        for line in lines:
            line.close()
    parts = {target.name: line.outcome(target) for line in lines for target in line.targets.values()}
    return {name: parts[name] if name in parts else KillPart(False, problems[name]) for name in names}


def _lines(plan: KillPlan, names: Sequence[str]) -> tuple[list[_Line], dict[str, str]]:
    """Make the lines of these vehicles, and say why others have none. Raises: ConfigError when none has."""
    lines: list[_Line] = []
    taken = {link.link_id for link in plan.links}
    own_id = next((number for number in range(255, 0, -1) if number not in taken), 0)
    problems = dict.fromkeys(names, "its link is not known")
    for link in plan.links:
        known = plan.addresses
        here = [name for name in link.system_ids if name in problems]
        targets = {
            link.system_ids[name]: _Target(name, link.system_ids[name], known.get(name)) for name in here
        }
        if not targets:
            continue
        try:
            lines.append(_Line(link, ports_of(link), targets, _signing(link, own_id)))
        except ConfigError as error:
            problems |= dict.fromkeys(here, str(error))
    if not lines:
        raise ConfigError("; ".join(dict.fromkeys(problems.values())))
    return lines, problems


def _signing(link: KillLink, own_id: int) -> mavlink.MAVLinkSigning:
    """Sign as a link of our own: else vehicles refuse the frames of a service that goes on as repeated ones.

    Raises: ConfigError for a key that cannot be read.
    """
    made = mavlink.MAVLinkSigning()
    if link.key_file is None:
        return made
    from gcs.links.signing_key import load_key, stored, time_file  # noqa: PLC0415 (numpy, of its package)
    from gcs.mavlink.signing_time import signing_time  # noqa: PLC0415

    made.secret_key, made.link_id, made.sign_outgoing = load_key(link.key_file), own_id, True
    made.timestamp = signing_time(time.time())
    with suppress(LinkError):  # no time is kept beside the key
        made.timestamp = max(made.timestamp, stored(time_file(link.key_file, link.link_id)))
    return made
