"""Requests the vehicles' streams with SET_MESSAGE_INTERVAL, a few vehicles at a time."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from typing import Final

from pymavlink.dialects.v20 import development as dialect

from gcs.links.stream_rates import REQUESTING_COMPONENT, Rates
from gcs.links.telemetry import VehicleTelemetry
from gcs.mavlink.framing import COMMAND_ACK, SET_MESSAGE_INTERVAL, Frame, acknowledged_component

_PERIOD_S: Final = 0.05
_VEHICLES_AT_ONCE_MAX: Final = 4  # about a millisecond of the loop's time
_OFF: Final = -1.0


def interval_frame(target: int, message_id: int, rate_hz: float, station_id: int) -> bytes:
    """COMMAND_LONG with SET_MESSAGE_INTERVAL (511); rate 0 ends the stream."""
    packer = dialect.MAVLink(None, srcSystem=station_id, srcComponent=REQUESTING_COMPONENT)
    interval_us = 1e6 / rate_hz if rate_hz else _OFF
    message = packer.command_long_encode(
        target, 1, SET_MESSAGE_INTERVAL, 0, message_id, interval_us, 0, 0, 0, 0, 0
    )
    return bytes(message.pack(packer))


def is_answer(frame: Frame) -> bool:
    """Whether a frame acknowledges a request of this module."""
    return frame.message_id == COMMAND_ACK and acknowledged_component(frame) == REQUESTING_COMPONENT


async def keep_requesting(
    received: Mapping[int, VehicleTelemetry],
    desired: Mapping[int, float],
    station_id: int,
    is_met: Callable[[int], bool],
    send: Callable[[bytes], None],
    clock: Callable[[], float],
) -> None:
    """Request the desired rates from all discovered vehicles, without end."""
    rates = Rates(desired, received)
    turn = deque(received.items())
    while desired:
        asked = 0
        for _ in range(len(turn)):
            system_id, of_it = turn[0]
            turn.rotate(-1)
            due = tuple(rates.due(system_id, of_it, clock())) if is_met(system_id) else ()
            for message_id, rate_hz in due:
                send(interval_frame(system_id, message_id, rate_hz, station_id))
            asked += bool(due)
            if asked == _VEHICLES_AT_ONCE_MAX:
                break
        await asyncio.sleep(_PERIOD_S)
