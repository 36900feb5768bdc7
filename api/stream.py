"""The fleet over a WebSocket: the newest state, at the viewer's pace.

The stream samples; it queues nothing. A reader that is slow gets fewer frames, each the newest when it was
sent, and delays nobody.
"""

import asyncio
from typing import Final

from fastapi import APIRouter, WebSocket
from starlette.websockets import WebSocketDisconnect

from api.desk import Desk, DeskDep
from api.door import SUBPROTOCOL
from gcs.errors import InvalidError, RefusedError

RATE_DEFAULT_HZ: Final = 10.0
RATE_MIN_HZ: Final = 1.0
RATE_MAX_HZ: Final = 20.0

REPEAT_S: Final = 1.0
"""An unchanged state is sent again after this, so that a viewer learns when control has died."""

POLICY_VIOLATION: Final = 1008
TRY_AGAIN_LATER: Final = 1013

router = APIRouter()


def rate_hz(text: str | None) -> float:
    """The rate asked for. Raises: InvalidError when it is none, or out of bounds."""
    if text is None:
        return RATE_DEFAULT_HZ
    allowed = f"a number from {RATE_MIN_HZ:g} to {RATE_MAX_HZ:g}"
    try:
        rate = float(text)
    except ValueError:
        raise InvalidError("rate_hz", text[:20], allowed) from None
    if not RATE_MIN_HZ <= rate <= RATE_MAX_HZ:
        raise InvalidError("rate_hz", text[:20], allowed)
    return rate


@router.websocket("/stream")
async def stream(websocket: WebSocket, desk: DeskDep) -> None:
    """Send the fleet until the viewer has gone. A bad request is told why with the close frame."""
    offered = websocket.scope["subprotocols"]
    await websocket.accept(SUBPROTOCOL if SUBPROTOCOL in offered else None)
    try:
        period_s = 1.0 / rate_hz(websocket.query_params.get("rate_hz"))
        with desk.seat():
            await _watch(websocket, desk, period_s)
    except InvalidError as error:
        await websocket.close(POLICY_VIOLATION, str(error))
    except RefusedError as error:
        await websocket.close(TRY_AGAIN_LATER, str(error))


async def _watch(websocket: WebSocket, desk: Desk, period_s: float) -> None:
    async with asyncio.TaskGroup() as group:
        sender = group.create_task(_send(websocket, desk, period_s), name="stream/send")
        await _gone(websocket)
        sender.cancel()


async def _send(websocket: WebSocket, desk: Desk, period_s: float) -> None:
    """Sample and send; returns when the viewer has gone."""
    loop = asyncio.get_running_loop()
    sent, sent_time_s = None, 0.0
    due_s = loop.time()
    while True:
        if not websocket.state.is_welcome():
            await websocket.close(POLICY_VIOLATION, "the token was revoked")
            return
        if desk.view is not sent or loop.time() - sent_time_s >= REPEAT_S:
            sent, sent_time_s = desk.view, loop.time()
            try:
                await websocket.send_text(desk.fleet_json())
            except WebSocketDisconnect:
                return
        due_s = max(due_s + period_s, loop.time())  # what a slow reader missed is not made up
        await asyncio.sleep(due_s - loop.time())


async def _gone(websocket: WebSocket) -> None:
    """Returns when the viewer has closed; what it says meanwhile is not listened to."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass
