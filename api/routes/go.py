"""Routes of what people say before a start: checklists and weather. They only translate."""

from fastapi import APIRouter

from gcs.api.context import ContextDep
from gcs.api.openapi import TOKEN, command
from gcs.api.schemas import requests
from gcs.service import GoView, WeatherEntry

router = APIRouter(dependencies=TOKEN)


@router.get("/go", tags=["preflight"], summary="What a start needs of people")
async def get_go(context: ContextDep) -> GoView:
    """The proposed start with its hash, the checklists with their signatures, and the weather."""
    return context.view.features.go or GoView.none()


@router.post("/go/sign", tags=["preflight"], summary="Sign items of a checklist", **command(404))
async def sign_checklist(body: requests.ChecklistItems, context: ContextDep) -> GoView:
    """Signed with the token's name and the time. Another show, other parameters and a landing open them."""
    return context.service.go.sign(body.role, body.items)


@router.post("/go/reopen", tags=["preflight"], summary="Open items of a checklist again", **command(404))
async def reopen_checklist(body: requests.ChecklistItems, context: ContextDep) -> GoView:
    """Takes the signatures of these items back; a proposed start is called off by that."""
    return context.service.go.reopen(body.role, body.items)


@router.put("/go/weather", tags=["preflight"], summary="Enter the weather", **command())
async def enter_weather(body: requests.Weather, context: ContextDep) -> GoView:
    """Replaces the entry before; what is absent is not known."""
    return context.service.go.enter_weather(WeatherEntry(**body.given()))
