"""Datagrams from vehicles: split into frames, checked, and passed to their readers."""

from collections.abc import Callable

import numpy as np

from gcs.links.counters import Counters, Direction, Observer
from gcs.links.link import ParameterValue
from gcs.links.udp.addresses import Addresses
from gcs.links.udp.commands import COMMAND_ACK, PARAM_VALUE, Commands, parameter_values
from gcs.links.udp.sockets import Datagrams
from gcs.links.udp.stream_requests import Streams
from gcs.links.udp.telemetry import FleetTelemetry
from gcs.mavlink import codec
from gcs.mavlink.kernels import BEGIN, COMPONENT, DATAGRAM, END, MESSAGE, SYSTEM, Bytes, Whole
from gcs.model.state import Array

_AUTOPILOT_COMPONENT = 1


class Inbox:
    """Reads what arrived. Whatever the bytes, it never raises.

    Attributes:
        observers: receive every frame; replace the tuple, do not mutate it.
        commands: reads answers; None: no reader.
        note_parameter: called with row, name and value of every PARAM_VALUE; None: not called.
        pass_on: called with (data, frames, rows, times) of accepted frames, as `FleetTelemetry.take`; None:
            not called.
    """

    def __init__(
        self, addresses: Addresses, telemetry: FleetTelemetry, streams: Streams, counters: Counters
    ) -> None:
        self.observers: tuple[Observer, ...] = ()
        self.commands: Commands | None = None
        self.note_parameter: Callable[[int, str, ParameterValue], None] | None = None
        self.pass_on: Callable[[Bytes, Whole, Whole, Array], None] | None = None
        self._addresses = addresses
        self._telemetry = telemetry
        self._streams = streams
        self._counters = counters

    def take(self, arrived: Datagrams) -> None:
        """Read a batch of datagrams."""
        found = codec.find(arrived.data, arrived.start, arrived.length)
        self._counters.garbage_bytes += found.garbage_bytes
        self._counters.unknown_bytes += found.unknown_bytes
        rows, taken = self._addresses.judge(found.frames, arrived)
        frames, rows = found.frames[taken], rows[taken]
        time_s = arrived.time_s[frames[:, DATAGRAM]]
        self._counters.received += len(frames)
        self._telemetry.take(arrived.data, frames, rows, time_s)
        self._take_answers(arrived.data, frames, rows)
        if self.pass_on is not None:
            self.pass_on(arrived.data, frames, rows, time_s)
        for observer in self.observers:
            for frame, at_s in zip(frames.tolist(), time_s.tolist(), strict=True):
                raw = arrived.data[frame[BEGIN] : frame[END]].tobytes()
                observer(at_s, Direction.RECEIVED, raw, frame[SYSTEM])

    def _take_answers(self, data: Bytes, frames: Whole, rows: Whole) -> None:
        message = np.where(frames[:, COMPONENT] == _AUTOPILOT_COMPONENT, frames[:, MESSAGE], -1)
        acks = np.flatnonzero(message == COMMAND_ACK)
        if len(acks):
            ack_records = codec.decode(COMMAND_ACK, data, frames[acks])
            self._streams.take_acks(rows[acks], ack_records)
            if self.commands is not None:
                self.commands.take_acks(rows[acks], ack_records)
        values = np.flatnonzero(message == PARAM_VALUE)
        if len(values):
            value_records = codec.decode(PARAM_VALUE, data, frames[values])
            if self.commands is not None:
                self.commands.take_values(rows[values], value_records)
            if self.note_parameter is not None:
                for row, (name, value) in zip(
                    rows[values].tolist(), parameter_values(value_records), strict=True
                ):
                    self.note_parameter(row, name, value)
