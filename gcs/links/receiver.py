"""Received datagrams: split into frames, checked, and passed to their readers."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.links import senders
from gcs.links.address_book import Addresses
from gcs.links.endpoints.cut_streams import CutStreams
from gcs.links.endpoints.ports import Datagrams
from gcs.links.fair_shares import fair_shares
from gcs.links.link import Counters, FrameDirection, Observer, ParameterValue
from gcs.links.link_intake import LinkIntake, newest_of_each
from gcs.links.listening import FrameListener
from gcs.links.odd_frames import odd_frames
from gcs.links.signing import SignatureFilter
from gcs.links.stream_requests import StreamRequests, count_messages
from gcs.links.telemetry import FleetTelemetry
from gcs.mavlink import codec
from gcs.mavlink.framing import COMMAND_ACK, PARAM_VALUE
from gcs.mavlink.kernels import BEGIN, END, FRAME_COLUMNS, LONGEST_FRAME, SYSTEM, Bytes, Whole
from gcs.model.state import Array, VehicleId


class ParameterUpdates:
    """Newest values of watched parameters that vehicles announce without a request, until they are read.

    PX4 answers each PARAM_SET with a PARAM_VALUE to all.
    """

    def __init__(self, ids: Sequence[VehicleId]) -> None:
        self._ids = ids  # by row
        self._names: frozenset[str] = frozenset()
        self._updates: dict[VehicleId, dict[str, ParameterValue]] = {}

    def watch(self, names: Collection[str]) -> None:
        self._names = frozenset(names)

    def take(self, row: int, name: str, value: ParameterValue) -> None:
        if name in self._names:
            self._updates.setdefault(self._ids[row], {})[name] = value

    def drain(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        updates, self._updates = self._updates, {}
        return updates


@dataclass(eq=False)
class Inbox:
    """Reads what arrived. Whatever the bytes, it never raises.

    Attributes:
        observers: receive every frame; replace the tuple, do not mutate it.
        take_acks: reads (k,) rows and their COMMAND_ACKs, in order of arrival.
        take_value: reads a row, and the name and value of a parameter.
        listeners: read further frames; replace the tuple, do not mutate it.
        pass_on: called with (data, frames, rows, times) of accepted frames, as `FleetTelemetry.take`; None:
            not called.
    """

    addresses: Addresses
    telemetry: FleetTelemetry
    streams: StreamRequests
    counters: Counters
    parameters: ParameterUpdates
    signatures: SignatureFilter | None = None

    def __post_init__(self) -> None:
        self.observers: tuple[Observer, ...] = ()
        self.listeners: tuple[FrameListener, ...] = ()
        self.take_acks: Callable[[Whole, codec.Records], None] = lambda _rows, _reported: None
        self.take_value: Callable[[int, str, ParameterValue], None] = lambda _row, _name, _value: None
        self.pass_on: Callable[[Bytes, Whole, Whole, Array], None] | None = None
        addresses = self.addresses
        self._intake = LinkIntake(addresses.name, addresses.source, addresses.address_of)
        self.counters.intakes.append(self._intake)
        self._cut_streams = CutStreams()

    def take(self, arrived: Datagrams) -> None:
        now_s = self.addresses.clock()
        arrived = self._intake.admit_datagrams(arrived, now_s)
        self._cut_streams.put_together(arrived)
        split = codec.find(arrived.data, arrived.start, arrived.length)
        self.counters.garbage_bytes += split.garbage_bytes
        self.counters.unknown_bytes += split.unknown_bytes
        frames = split.frames
        if self.signatures is not None:
            frames = frames[self.signatures.are_signed(arrived.data, frames, arrived.source)]
        frames = self._intake.admit_frames(frames, arrived, now_s)
        if self.signatures is not None:
            frames = frames[self.signatures.accepted(arrived.data, frames, arrived.source)]
        frames, rows, time_s = self.addresses.judge(frames, arrived)
        self.counters.received += len(frames)
        self.telemetry.take(arrived.data, frames, rows, time_s)
        self.counters.late_samples = self.telemetry.late_samples
        self._take_answers(arrived.data, frames, rows)
        for listener in self.listeners:
            listener.offer(arrived.data, frames, rows, time_s)
        if self.pass_on is not None:
            self.pass_on(arrived.data, frames, rows, time_s)
        for observer in self.observers:
            for frame, at_s in zip(frames.tolist(), time_s.tolist(), strict=True):
                raw = arrived.data[frame[BEGIN] : frame[END]].tobytes()
                observer(at_s, FrameDirection.RECEIVED, raw, frame[SYSTEM])

    def _take_answers(self, data: Bytes, frames: Whole, rows: Whole) -> None:
        acks, values = self.streams.count(rows, frames)
        if len(acks):
            ack_records = codec.decode(COMMAND_ACK, data, frames[acks])
            self.streams.take_acks(rows[acks], ack_records)
            self.take_acks(rows[acks], ack_records)
        if len(values):
            values = values[newest_of_each(rows[values])]
            value_records = codec.decode(PARAM_VALUE, data, frames[values])
            for row, reported in zip(rows[values].tolist(), value_records, strict=True):
                raw = np.array([reported["param_value"]], np.float32)
                value = self.telemetry.autopilots[row].decoded(raw, int(reported["param_type"]))
                name = codec.text(reported["param_id"])
                self.take_value(row, name, value)
                self.parameters.take(row, name, value)


def warm_up() -> None:
    """Compile or load the kernels."""
    nothing, none, times_s = np.zeros((0, FRAME_COLUMNS), np.int64), np.zeros(0, np.int64), np.zeros(0)
    senders.warm_up()
    odd_frames(nothing, none, none, np.zeros(0, np.bool_))
    fair_shares(np.zeros(1, np.int64), np.ones(1, np.int64), none, 0.0)
    CutStreams().put_together(Datagrams(np.zeros(1, np.uint8), none, none, none, times_s, LONGEST_FRAME))
    count_messages(none, nothing, none, nothing)
