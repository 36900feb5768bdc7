"""A new installation compiles before the first telemetry arrives: meanwhile it would read nothing."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from gcs.flight.composition import warm_up
from gcs.links import receiver, sender
from gcs.mavlink import codec, reports
from gcs.model.lifecycle import ShowPhase
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.kernels import signatures


async def into_formation(show: VirtualShow) -> None:
    await show.standby()
    await show.start()
    await show.reach(ShowPhase.RUNNING)
    await show.wait(2.0)


def compiled_in_flight() -> list[str]:
    """The kernels that were compiled or loaded, or for other types, only after all warm-ups."""
    for load in (warm_up, codec.warm_up, reports.warm_up, sender.warm_up, receiver.warm_up):
        load()  # as a service does, and its links, before they read
    before = signatures()
    fly(into_formation, show_config(2))
    return [name for name, many in signatures().items() if many != before.get(name, 0)]


@pytest.mark.long
def test_nothing_is_compiled_by_the_first_telemetry() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as fresh:  # other tests compile other types
        assert fresh.submit(compiled_in_flight).result() == []
