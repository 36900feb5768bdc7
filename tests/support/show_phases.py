"""Leads a virtual show into one of its phases, as an operator does."""

from gcs.model.lifecycle import ShowPhase
from gcs.service import ShowAction
from gcs.testing.virtual_show import VirtualShow


async def on_the_pads(show: VirtualShow) -> None:
    await show.standby()


async def arming(show: VirtualShow) -> None:
    await show.standby()
    show.service.commands.command_show(ShowAction.START)


async def assembling(show: VirtualShow) -> None:
    await arming(show)
    await show.reach(ShowPhase.ASSEMBLING)


async def running(show: VirtualShow) -> None:
    if show.view.show is not ShowPhase.RUNNING:
        await show.start()


async def paused(show: VirtualShow) -> None:
    await running(show)
    show.service.commands.command_show(ShowAction.PAUSE)


async def returning(show: VirtualShow) -> None:
    await running(show)
    show.service.commands.command_show(ShowAction.STOP)


async def aborting(show: VirtualShow) -> None:
    await running(show)
    show.service.commands.command_show(ShowAction.ABORT)
