"""The fleet over a WebSocket: the newest state, as fast as the viewer reads.

The stream samples the state and queues nothing. A slow viewer receives fewer frames, each the newest when it
was sent, and delays no other viewer. A state is sent right after the tick that made it, when the event loop
has most time.
"""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, suppress
from typing import Final, TypeAlias

from fastapi import APIRouter, WebSocket
from starlette.websockets import WebSocketDisconnect

from gcs.api.auth.authorization import SUBPROTOCOL
from gcs.api.context import Context, ContextDep
from gcs.model.errors import InvalidError, RefusedError

RATE_DEFAULT_HZ: Final = 10.0
RATE_MIN_HZ: Final = 1.0
RATE_MAX_HZ: Final = 20.0

EARLY: Final = 0.25
"""Share of the period by which a state may be sent early: the next state might come much later."""

REPEAT_S: Final = 0.5
"""An unchanged state is sent again after this time, so that a viewer notices when control has stopped."""

POLICY_VIOLATION: Final = 1008
TRY_AGAIN_LATER: Final = 1013

Messages: TypeAlias = Callable[[Context], list[str | bytes]]
"""Makes the messages that one viewer is sent at one time."""

router = APIRouter()


def rate_hz(text: str | None) -> float:
    """Parse the requested rate. Raises: InvalidError when it is not a number, or out of bounds."""
    if text is None:
        return RATE_DEFAULT_HZ
    allowed = f"a number from {RATE_MIN_HZ:g} to {RATE_MAX_HZ:g}"
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not RATE_MIN_HZ <= rate <= RATE_MAX_HZ:
        raise InvalidError("rate_hz", text[:20], allowed)
    return rate


@router.websocket("/stream")
async def stream(websocket: WebSocket, context: ContextDep) -> None:
    """Send the fleet until the viewer disconnects. The close frame has the reason of a refusal."""
    await _watched(websocket, context, lambda context: [context.fleet_json()])


@router.websocket("/stream/console")
async def console(websocket: WebSocket, context: ContextDep) -> None:
    """The console's stream: binary frames, each after the status if that has changed (docs/stream.md)."""
    seen = 0

    def messages(context: Context) -> list[str | bytes]:
        nonlocal seen
        revision, status = context.feed.status(context.now_s())
        updates = [status] if revision != seen else []
        seen = revision
        return [*updates, context.feed.frame()]

    await _watched(websocket, context, messages)


async def _watched(websocket: WebSocket, context: Context, messages: Messages) -> None:
    offered = websocket.scope["subprotocols"]
    await websocket.accept(SUBPROTOCOL if SUBPROTOCOL in offered else None)
    try:
        period_s = 1.0 / rate_hz(websocket.query_params.get("rate_hz"))
        with context.viewer_slot():
            async with asyncio.TaskGroup() as group:
                sending = _send(websocket, context, period_s, messages)
                sender = group.create_task(sending, name="stream/send")
                while (await websocket.receive())["type"] != "websocket.disconnect":
                    pass  # the viewer's messages are ignored
                sender.cancel()
    except InvalidError as error:
        await websocket.close(POLICY_VIOLATION, str(error))
    except RefusedError as error:
        await websocket.close(TRY_AGAIN_LATER, str(error))


async def _send(websocket: WebSocket, context: Context, period_s: float, messages: Messages) -> None:
    """Sample and send until the viewer disconnects or its token is revoked."""
    async with aclosing(_moments(websocket, context, period_s)) as moments:
        async for _ in moments:
            if not websocket.state.is_authorized():
                await websocket.close(POLICY_VIOLATION, "the token was revoked")
                return
            try:
                for message in messages(context):
                    if isinstance(message, str):
                        await websocket.send_text(message)
                    else:
                        await websocket.send_bytes(message)
            except WebSocketDisconnect:
                return


async def _moments(websocket: WebSocket, context: Context, period_s: float) -> AsyncGenerator[None, None]:
    """Yield when to sample: at once, then at the tick that follows each due time, when nothing is unsent."""
    loop = asyncio.get_running_loop()
    early_s = EARLY * period_s
    due_s = loop.time()
    while True:
        await websocket.state.drained()
        yield
        due_s = max(due_s + period_s, loop.time() - early_s)  # missed frames are not sent later
        await asyncio.sleep(due_s - early_s - loop.time())
        with suppress(TimeoutError):
            async with asyncio.timeout(REPEAT_S):
                await context.service.view.changed()
