"""Sockets and ports of the framed link: every byte passes here, and no setpoint without permission.

Everything happens on the loop's thread, when `receive` and `send` are called.
"""

import logging
import selectors
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from gcs.links.address_book import TAKEN, Address, AddressBook, Verdict
from gcs.links.counters import Counters, Direction, Observer
from gcs.links.endpoints import Arrival, Listen, Place, make
from gcs.links.endpoints.udp import Udp
from gcs.links.framed.forwarding import Forwarder, may_pass
from gcs.links.framed.setpoint_gate import SetpointGate
from gcs.links.kill_latch import KillLatch
from gcs.links.mmsg import Batch
from gcs.links.setpoint_watchdog import ExpectedSetpoints, HeartbeatGate, SetpointWatchdog
from gcs.links.settings import Forward
from gcs.links.signing_keys import Signing
from gcs.links.telemetry import VehicleTelemetry
from gcs.mavlink.framing import (
    HEARTBEAT,
    PING,
    RADIO_STATUS,
    SETPOINT_MESSAGES,
    Frame,
    asked_velocity,
    moves,
    split,
    target_system,
)
from gcs.mavlink.signing import Judgement
from gcs.model.errors import LinkError

__all__ = ["Counters", "Direction", "Listen", "Observer", "Router"]

log = logging.getLogger(__name__)

_RECORD_LENGTH: Final = 4096
_STRANGERS_LOGGED_MAX: Final = 64
_TEND_PERIOD_S: Final = 0.02
_TURN_S: Final = 0.02
_READ_LEAST_S: Final = 0.001
_GARBAGE_S: Final = 0.004
"""Time that a port may spend on garbage, so that one that jams a shared port does not silence the others.

A flooded port must delay neither the loop nor other ports: the ports that are ready share a turn's time, and
the rest waits for the next turn, with its time of arrival.
"""


class Router:
    """Sockets and ports, routing by system id, arrival times, the setpoint watchdog, times of sent setpoints.

    Attributes:
        telemetry: telemetry of each configured system id.
        counters: totals, for metrics.
        observers: receive every frame; replace the tuple, do not mutate it.
    """

    def __init__(
        self,
        *,
        name: str,
        system_ids: Iterable[int],
        listen: Place | Sequence[Place],
        setpoint_watchdog: SetpointWatchdog,
        latch: KillLatch,
        clock: Callable[[], float],
        deliver: Callable[[Frame], None],
        station_id: int = 245,
        asked: ExpectedSetpoints | None = None,
        heartbeat_gate: HeartbeatGate | None = None,
        signing: Signing | None = None,
        forward: Sequence[Forward] = (),
    ) -> None:
        """Nothing is opened yet.

        Args:
            name: the link's, for errors and logs.
            system_ids: the vehicles; frames of other systems are counted.
            listen: where they are.
            setpoint_watchdog: permits setpoints.
            latch: drops what was commanded before a kill.
            clock: the loop's.
            deliver: called with every accepted frame, on the thread that receives.
            station_id: our own system id.
            asked: distinguishes old setpoints from new ones; without it none counts as old.
            heartbeat_gate: permits our heartbeats; without it they always leave.
            signing: signs sent frames and judges received ones. The owner opens and closes it.
            forward: further ground stations.
        """
        self.telemetry: Mapping[int, VehicleTelemetry] = MappingProxyType(
            {system_id: VehicleTelemetry() for system_id in system_ids}
        )
        self.counters = Counters()
        self.observers: tuple[Observer, ...] = ()
        self._name = name
        self._setpoint_watchdog = setpoint_watchdog
        self._latch = latch
        self._clock = clock
        self._deliver = deliver
        self._station_id = station_id
        self._asked = asked
        self._heartbeat_gate = heartbeat_gate
        self._signing = signing
        self._address_book = AddressBook(self.telemetry)
        self._endpoints = make(name, listen if isinstance(listen, Sequence) else (listen,))
        self._tended = tuple(each for each in self._endpoints if not isinstance(each, Udp))
        self._far = tuple(each for each in self._endpoints if each.standing or each in self._tended)
        self._tend_s = 0.0
        self._forwarders = tuple(Forwarder(each, self.counters) for each in forward)
        self._selector: selectors.BaseSelector | None = None
        self._sent_s: Mapping[int, deque[float]] = {
            system_id: deque(maxlen=_RECORD_LENGTH) for system_id in self.telemetry
        }
        self._gate = SetpointGate(
            setpoint_watchdog=setpoint_watchdog,
            latch=latch,
            asked=asked,
            address_of=self._address_book.address,
            endpoints=self._endpoints,
            counters=self.counters,
            clock=clock,
            failed=self._note_failure,
        )
        self._strangers: set[tuple[int, str]] = set()
        self._refused: set[tuple[int, Judgement]] = set()
        self._failing: set[Address] = set()

    def open(self) -> None:
        """Bind every port. Raises: LinkError naming the port."""
        self._selector = selectors.DefaultSelector()
        now_s = self._clock()
        try:
            for endpoint in self._endpoints:
                endpoint.open(self._selector, now_s)
            for forwarder in self._forwarders:
                forwarder.open()
        except LinkError:
            self.close()
            raise

    def close(self) -> None:
        """Release the ports; frames sent afterwards go nowhere."""
        selector, self._selector = self._selector, None
        for endpoint in self._endpoints:
            endpoint.close()
        for forwarder in self._forwarders:
            forwarder.close()
        if selector is not None:
            selector.close()

    def receive(self) -> None:
        """Read what has arrived, as much as a turn has time for. Never blocks.

        To be called every few milliseconds. Waking the loop for every datagram would cost more, and nothing
        is lost by waiting, since the kernel notes the times of arrival.
        """
        if self._selector is None:
            return
        now_s = self._clock()
        self._read(self._selector.select(0), now_s)
        if now_s >= self._tend_s:
            self._tend_s = now_s + _TEND_PERIOD_S
            for endpoint in self._tended:
                endpoint.tend(now_s)
        for endpoint in self._tended:
            for address in endpoint.gone():
                self._address_book.forget(address)
                self._failing.discard(address)
        for forwarder in self._forwarders:
            forwarder.flush()
            for frame in forwarder.read():
                self._take_from_other(frame)

    def send(self, data: bytes, *, to_everybody: bool = True) -> None:
        """Send our own frames, each to its target, unless watchdog or latch forbid it. Never raises.

        Args:
            data: one frame or several.
            to_everybody: whether frames without a target also leave.
        """
        for frame in split(data, checked=False).frames:
            target = target_system(frame)
            if target == 0 and (frame.message_id == PING or not to_everybody):
                continue  # a broadcast for each known vehicle would grow with the square of the fleet
            if frame.message_id == HEARTBEAT and self._is_dead():
                continue
            if frame.message_id in SETPOINT_MESSAGES:
                self._send_setpoint(frame, target)
            else:
                self._send_unless_killed(frame, target)

    def send_batch(self, written: Batch, count: int, *, to_everybody: bool = True) -> None:
        """Send the first `count` datagrams of a batch, as `send` does each. Never raises."""
        others: Iterable[int] = range(count)
        if self._signing is None:
            others = self._gate.send(written, count, self._note_setpoint, self.observers)
        for row in others:
            self.send(written.data[row, : written.length[row]].tobytes(), to_everybody=to_everybody)

    def send_kill(self, data: bytes) -> None:
        """Send a kill command, which no latch drops. Never raises."""
        for frame in split(data).frames:
            self._send_frame(frame, target_system(frame))

    def conflicts(self) -> dict[int, str]:
        """System ids with recent frames from two addresses, both named in the text."""
        return self._address_book.conflicts(self._clock())

    def address(self, system_id: int) -> Address | None:
        """Source of this system's newest frame; None before the first."""
        return self._address_book.address(system_id)

    def setpoint_times_s(self, system_id: int) -> tuple[float, ...]:
        """Times at which the latest setpoints to this system left, oldest first; bounded."""
        return tuple(self._sent_s[system_id])

    def _send_setpoint(self, frame: Frame, target: int) -> None:
        if self._latch.is_shut(target):
            self.counters.commands_dropped += 1
        elif not self._setpoint_watchdog.allows(target, self._clock()) or self._is_old(frame, target):
            self.counters.setpoints_dropped += 1
        elif self._send_frame(frame, target, perishable=True):
            self._note_setpoint(target)

    def _note_setpoint(self, target: int) -> None:
        """Record that a setpoint has left."""
        record = self._sent_s.get(target)
        if record is not None:
            record.append(self._clock())  # after the call: never earlier than the datagram
        self.counters.setpoints_sent += 1

    def _is_old(self, frame: Frame, target: int) -> bool:
        """Whether a setpoint differs from the newest tick's."""
        return self._asked is not None and not self._asked.is_newest(target, asked_velocity(frame))

    def _is_dead(self) -> bool:
        """Whether control has not run for so long that our heartbeats must stop."""
        if self._heartbeat_gate is None or self._heartbeat_gate.is_alive(self._clock()):
            return False
        self.counters.heartbeats_withheld += 1
        return True

    def _send_unless_killed(self, frame: Frame, target: int) -> bool:
        """Returns whether the frame left."""
        if self._latch.is_shut(target) and moves(frame):
            self.counters.commands_dropped += 1
            return False
        return self._send_frame(frame, target)

    def _send_frame(self, frame: Frame, target: int, *, perishable: bool = False) -> bool:
        """Returns whether the frame left to at least one address."""
        addresses = self._addresses(target)
        if self._signing is None:
            raw = frame.raw
            left = sum([self._send_to(raw, address, target, perishable) for address in addresses])
        else:
            raw = self._signing.sign(frame.raw) or b""
            left = sum([self._send_to(raw, address, target, perishable) for address in addresses if raw])
        self.counters.sent += left
        self.counters.unroutable += not addresses
        self.counters.not_signed += not raw
        if left:
            now_s = self._clock()
            for observer in self.observers:
                observer(now_s, Direction.SENT, raw, target)
        return left > 0

    def _addresses(self, target: int) -> tuple[Address, ...]:
        if target:
            address = self._address_book.address(target)
            return () if address is None else (address,)
        if not self._far:
            return self._address_book.everybody
        unheard = [address for endpoint in self._far for address in endpoint.standing]
        return tuple(dict.fromkeys((*self._address_book.everybody, *unheard)))

    def _send_to(self, data: bytes, address: Address, target: int, perishable: bool) -> bool:
        send = self._endpoints[address.socket_index].send
        # Check again right before the call: the thread or the process may have been suspended since the last
        # check.
        if perishable and not self._setpoint_watchdog.allows(target, self._clock()):
            self.counters.setpoints_dropped += 1
            return False
        try:
            send(data, address, perishable=perishable)
        except OSError as error:
            self._note_failure(address, error)
            return False
        return True

    def _note_failure(self, address: Address, error: OSError) -> None:
        """Count and log a frame that could not be sent."""
        if isinstance(error, BlockingIOError):  # slow: this frame is lost, later ones may leave
            self.counters.no_room += 1
            return
        self.counters.send_errors += 1  # no route, or the peer's port is closed: it may come back
        if address not in self._failing and self._selector is not None:
            about = {"link": self._name, "address": str(address), "cause": str(error)}
            log.warning("send_failed", extra=about)
        self._failing.add(address)

    def _read(self, ready: Sequence[tuple[selectors.SelectorKey, int]], now_s: float) -> None:
        """Read these ports, each for its share of a turn."""
        share_s = max(_TURN_S / max(len(ready), 1), _READ_LEAST_S)
        for key, _ in ready:
            read_s = self._clock()
            until_s, garbage_s = read_s + share_s, 0.0
            for arrival in key.data(now_s):
                self._receive(arrival)
                before_s, read_s = read_s, self._clock()
                if arrival.parts.garbage_bytes or arrival.parts.unknown_bytes:
                    garbage_s += read_s - before_s
                if read_s > until_s or garbage_s > _GARBAGE_S:
                    break

    def _receive(self, arrival: Arrival) -> None:
        (frames, garbage_bytes, unknown_bytes), address, time_s = (
            arrival.parts,
            arrival.address,
            arrival.time_s,
        )
        self.counters.garbage_bytes += garbage_bytes
        self.counters.unknown_bytes += unknown_bytes
        for frame in frames:
            system_id = frame.system_id
            if self._signing is not None and not self._has_signed(self._signing, frame, address):
                continue
            verdict = self._address_book.hear(system_id, address, time_s)
            if verdict is not Verdict.KNOWN:
                self._note(verdict, frame, address)
            if verdict not in TAKEN:
                continue
            self.counters.received += 1
            self.telemetry[system_id].take(frame, time_s)
            self._deliver(frame)
            for observer in self.observers:
                observer(time_s, Direction.RECEIVED, frame.raw, system_id)
            for forwarder in self._forwarders:
                forwarder.offer(frame.raw)

    def _take_from_other(self, frame: Frame) -> None:
        """Pass a frame of another ground station on to a vehicle, where that is allowed."""
        signed = self._signing is None or self._signing.judge(frame) is Judgement.GOOD
        passes = signed and may_pass(frame, self.telemetry, self._station_id)
        if passes and self._send_unless_killed(frame, target_system(frame)):
            self.counters.taken_from_others += 1
        else:
            self.counters.refused_from_others += 1

    def _has_signed(self, signing: Signing, frame: Frame, address: Address) -> bool:
        """Whether a vehicle's frame is accepted. Unknown systems are left to the address book."""
        if frame.system_id not in self.telemetry:
            return True
        judgement = signing.judge(frame)
        if judgement is Judgement.GOOD:
            return True
        if frame.message_id == RADIO_STATUS:
            return False  # made by the radio, which has no key: not accepted, and not counted
        self.counters.unsigned += judgement is Judgement.UNSIGNED
        self.counters.wrongly_signed += judgement is Judgement.WRONG
        self.counters.replayed += judgement is Judgement.REPLAYED
        if (frame.system_id, judgement) not in self._refused:
            self._refused.add((frame.system_id, judgement))
            about = {"link": self._name, "system_id": frame.system_id, "address": str(address)}
            log.error("signature_refused", extra=about | {"cause": judgement.name.lower()})
        return False

    def _note(self, verdict: Verdict, frame: Frame, address: Address) -> None:
        """Count frames that were not accepted, and log every change once."""
        about = {"link": self._name, "system_id": frame.system_id, "address": str(address)}
        if verdict is Verdict.FIRST:
            log.info("vehicle_connected", extra=about)
        elif verdict is Verdict.MOVED:
            log.warning("vehicle_moved", extra=about)
        elif verdict is Verdict.STRANGER:
            self.counters.strangers += 1
            stranger = (frame.system_id, address.host)
            if stranger not in self._strangers and len(self._strangers) < _STRANGERS_LOGGED_MAX:
                self._strangers.add(stranger)
                log.info("stranger_ignored", extra=about)
        else:
            self.counters.duplicates += 1
            if verdict is Verdict.NEW_DUPLICATE:
                cause = self._address_book.conflicts(self._clock()).get(frame.system_id, "")
                log.error("duplicate_system_id", extra=about | {"cause": cause})
