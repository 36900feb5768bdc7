"""A target's reports over a WebSocket: each a JSON object; what is wrong with one is answered."""

import json
from http import HTTPStatus
from typing import Final

from fastapi import APIRouter, WebSocket
from pydantic import ValidationError
from starlette.datastructures import Headers
from starlette.types import Message

from gcs.api.auth.authorization import SUBPROTOCOL, Bucket
from gcs.api.auth.middleware import find_problem
from gcs.api.context import Context, ContextDep
from gcs.api.errors import error_response, from_pydantic, invalid_response
from gcs.api.routes.stream import POLICY_VIOLATION, TRY_AGAIN_LATER
from gcs.api.schemas import reports, requests
from gcs.model.errors import GcsError, RefusedError
from gcs.model.target_fix import TargetFix
from gcs.service import CALLER, Call

RATE_MAX_HZ: Final = 50.0
"""Reports a second of one connection; more are dropped unread, and counted in an answer."""

AS_JSON: Final = Headers({"content-type": "application/json"})

router = APIRouter()


@router.websocket("/targets/{name}/reports")
async def receive_reports(websocket: WebSocket, name: str, context: ContextDep) -> None:
    """Take reports until the sender disconnects. A bad one is answered, and ends nothing."""
    await websocket.accept(SUBPROTOCOL if SUBPROTOCOL in websocket.scope["subprotocols"] else None)
    try:
        with context.viewer_slot():
            about = CALLER.get(), "WEBSOCKET", websocket.url.path, ""
            context.service.audit.call(Call(*about, HTTPStatus.SWITCHING_PROTOCOLS))
            await _receive(websocket, context, name)
    except RefusedError as error:
        await websocket.close(TRY_AGAIN_LATER, str(error))


async def _receive(websocket: WebSocket, context: Context, name: str) -> None:
    bucket, dropped = Bucket(RATE_MAX_HZ, RATE_MAX_HZ), 0
    while (message := await websocket.receive())["type"] != "websocket.disconnect":
        if not websocket.state.is_authorized():
            await websocket.close(POLICY_VIOLATION, "the token was revoked")
            return
        if not bucket.take(context.now_s()):
            dropped += 1
            continue
        answers = []
        if dropped:
            detail = f"{dropped} reports were dropped unread: {RATE_MAX_HZ:g} a second may come"
            answers.append(bytes(error_response(HTTPStatus.TOO_MANY_REQUESTS, detail).body))
            dropped = 0
        answers.append(_problem(message, context, name))
        for answer in filter(None, answers):
            await websocket.send_text(answer.decode())


def _problem(message: Message, context: Context, name: str) -> bytes:
    """Pass one report on. Returns: what is wrong with it, in the common shape of errors; empty: nothing."""
    body = message.get("bytes") or (message.get("text") or "").encode()
    problem = find_problem(AS_JSON, body)
    if problem is not None:
        return bytes(invalid_response([problem]).body)
    try:
        report = requests.TargetReport.model_validate(json.loads(body))
        fix = TargetFix(context.now_s(), **report.model_dump(exclude_none=True))
        context.service.plan.report_target(name, fix)
    except json.JSONDecodeError as error:
        allowed = f"JSON; at character {error.pos}: {error.msg}"
        return bytes(invalid_response([reports.FieldProblem(field="body", value=None, allowed=allowed)]).body)
    except ValidationError as error:
        problems = [from_pydantic({**each, "loc": ("body", *each["loc"])}) for each in error.errors()]
        return bytes(invalid_response(problems).body)
    except GcsError as error:
        return bytes(error_response(HTTPStatus.CONFLICT, str(error)).body)
    return b""
