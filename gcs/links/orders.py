"""Orders to vehicles: MAVSDK's blocking calls off the loop, and belief only in the heartbeat.

PX4 acknowledges a change of mode twice, ACCEPTED first and the real result after; MAVSDK takes the first.
So an acknowledgement alone proves nothing, and its absence (a lost datagram) nothing either.
"""

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from math import isfinite
from typing import Final, TypeVar

from gcs.errors import OrderError
from gcs.links.heard import Heard
from gcs.links.killlatch import KillLatch
from gcs.links.link import Order, Verb
from gcs.links.mavsdk_fleet import MavsdkVehicle
from gcs.state import Landed, Mode, VehicleId

T = TypeVar("T")

CONFIRM_S: Final = 3.2
"""Heartbeats come once a second; three of them, and a little for the road."""

_REASON_S: Final = 0.3  # the status text that explains a refusal comes shortly after it
_OFFBOARD_TRIES: Final = 3
_OFFBOARD_RETRY_S: Final = 0.1
_KILL_REPEAT_S: Final = 0.1

_CLOSED: Final = "the link was closed"

_WANTED_MODE: Final = {
    Verb.TAKEOFF: Mode.TAKEOFF,
    Verb.HOLD: Mode.HOLD,
    Verb.OFFBOARD: Mode.OFFBOARD,
    Verb.LAND: Mode.LAND,
    Verb.RETURN: Mode.RETURN,
}


def obeyed(verb: Verb, heard: Heard, landed: Landed) -> bool:
    """Whether a vehicle's heartbeat (for TAKEOFF and LAND also its landed state) shows that it obeyed."""
    match verb:
        case Verb.ARM:
            return heard.armed
        case Verb.DISARM | Verb.KILL:
            return not heard.armed
        case Verb.TAKEOFF:
            climbed = landed in (Landed.IN_AIR, Landed.TAKEOFF)
            return heard.armed and (heard.mode is Mode.TAKEOFF or climbed)
        case Verb.LAND:
            return heard.mode is Mode.LAND or (landed is Landed.ON_GROUND and not heard.armed)
        case _:
            return heard.mode is _WANTED_MODE[verb]


class Orders:
    """Executes orders; one at a time per vehicle, except KILL, which waits for nobody."""

    def __init__(
        self, system_ids: Mapping[VehicleId, int], latch: KillLatch, clock: Callable[[], float]
    ) -> None:
        """One worker per vehicle, so that silent ones never keep another's order waiting."""
        self._system_ids = system_ids
        self._latch = latch
        self._clock = clock
        self._locks = {vehicle_id: asyncio.Lock() for vehicle_id in system_ids}
        self._closed = False
        self._workers = {
            vehicle_id: ThreadPoolExecutor(1, thread_name_prefix=f"order/{vehicle_id}")
            for vehicle_id in system_ids
        }

    def close(self) -> None:
        """Start no further call; orders under way fail. On the loop's thread, before `join`."""
        self._closed = True

    def join(self) -> None:
        """Wait for the calls under way, 5 s at most. Blocks."""
        for worker in self._workers.values():
            worker.shutdown(wait=True)

    async def execute(self, order: Order, vehicle: MavsdkVehicle, heard: Heard) -> None:
        """Order, and return when the vehicle's heartbeat shows that it obeyed. Raises: OrderError."""
        ticket = self._latch.ticket(self._system_ids[order.vehicle_id])
        async with self._locks[order.vehicle_id]:
            _refuse_the_impossible(order, heard)
            began_s = self._clock()
            cause = await self._command(order, vehicle, ticket)
            wait_s = CONFIRM_S if cause is None else _REASON_S
            if not await self._confirmed(order.verb, vehicle, heard, began_s, wait_s):
                raise OrderError(self._failure(order, cause, heard, began_s))

    async def call(self, vehicle_id: VehicleId, blocking: Callable[[], T]) -> T:
        """The result of a call of MAVSDK's on the vehicle's worker, between orders. Raises: OrderError."""

        def unless_closed() -> T:
            if self._closed:
                raise OrderError(_CLOSED)
            return blocking()

        if self._closed:  # then the workers take no more calls
            raise OrderError(f"{vehicle_id}: {_CLOSED}")
        try:
            return await asyncio.get_running_loop().run_in_executor(self._workers[vehicle_id], unless_closed)
        except OrderError as error:
            raise OrderError(f"{vehicle_id}: {error}") from error

    async def kill(self, order: Order, heard: Heard, send_kill: Callable[[], None]) -> None:
        """Send the kill command now and again until the heartbeat says disarmed. Raises: OrderError.

        Not through MAVSDK, where it would be one command among others: this one goes out at once, and shuts
        the latch behind it.
        """
        began_s = self._clock()
        self._latch.shut(self._system_ids[order.vehicle_id])
        while self._clock() - began_s < CONFIRM_S:
            send_kill()
            await _news(heard, _KILL_REPEAT_S)
            if heard.heartbeat_time_s > began_s and not heard.armed:
                return
        raise OrderError(self._failure(order, None, heard, began_s))

    async def _command(self, order: Order, vehicle: MavsdkVehicle, ticket: int) -> str | None:
        """Run MAVSDK's call on the vehicle's worker; the reason in words when it failed."""
        loop = asyncio.get_running_loop()
        worker = self._workers[order.vehicle_id]
        tries = _OFFBOARD_TRIES if order.verb is Verb.OFFBOARD else 1
        for left in reversed(range(tries)):
            if self._closed:
                return _CLOSED
            try:
                await loop.run_in_executor(worker, self._call, order, vehicle, ticket)
            except OrderError as error:
                # Outside OFFBOARD, MAVSDK forgets a setpoint after 3 s, until the next tick sets it again.
                if not left or str(error) != "NO_SETPOINT_SET":
                    return str(error)
                await asyncio.sleep(_OFFBOARD_RETRY_S)
            else:
                return None
        return None

    def _call(self, order: Order, vehicle: MavsdkVehicle, ticket: int) -> None:
        """On the worker: any earlier call has ended here, even one whose order was cancelled."""
        if not self._latch.redeem(self._system_ids[order.vehicle_id], ticket):
            raise OrderError("killed meanwhile")
        if self._closed:
            raise OrderError(_CLOSED)
        vehicle.command(order.verb, order.height_m)

    async def _confirmed(
        self, verb: Verb, vehicle: MavsdkVehicle, heard: Heard, began_s: float, wait_s: float
    ) -> bool:
        """Whether a heartbeat younger than the order shows it obeyed, within `wait_s`."""
        until_s = self._clock() + wait_s
        while not self._closed:  # a closed link's vehicles must not be asked any more
            if heard.heartbeat_time_s > began_s and obeyed(verb, heard, vehicle.landed()):
                return True
            left_s = until_s - self._clock()
            if left_s <= 0:
                return False
            await _news(heard, left_s)
        return False

    def _failure(self, order: Order, cause: str | None, heard: Heard, began_s: float) -> str:
        """Why an order failed, in words, with what the vehicle itself said since."""
        silent_s = self._clock() - heard.heartbeat_time_s
        state = f"it reports {heard.mode}, {'armed' if heard.armed else 'disarmed'}"
        if silent_s > CONFIRM_S:
            state = f"silent for {silent_s:.1f} s" if isfinite(silent_s) else "never heard"
        said = f'; it says "{heard.text}"' if heard.text_time_s >= began_s else ""
        failure = "sent, but not seen to happen" if cause is None else f"failed ({cause})"
        return f"{order.vehicle_id}: {order.verb} {failure}: {state}{said}"


async def _news(heard: Heard, wait_s: float) -> None:
    """Until the next heartbeat, or `wait_s`."""
    try:
        async with asyncio.timeout(wait_s):
            await heard.news.wait()
    except TimeoutError:
        return


def _refuse_the_impossible(order: Order, heard: Heard) -> None:
    if order.verb is Verb.TAKEOFF:
        if not (isfinite(order.height_m) and order.height_m > 0):
            raise OrderError(f"{order.vehicle_id}: takeoff to {order.height_m} m; a height above 0 is needed")
        if not heard.armed:  # PX4 would accept, and climb whenever it is armed next
            raise OrderError(f"{order.vehicle_id}: takeoff while disarmed; arm it first")
