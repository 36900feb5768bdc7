"""A site that is changed through the service: no start until it is in force, and no change in the air."""

from pathlib import Path

import pytest

from gcs.areas.files.geojson import write
from gcs.areas.files.site_files import read_site, written
from gcs.config.schema import Config, on_site
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.lifecycle import ShowPhase
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.fields import field

pytestmark = pytest.mark.soak

SITE, HIGHER = field(top_m=60.0), field(top_m=55.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "field.geojson"
    path.write_bytes(written(SITE, path))
    return path


def config(path: Path) -> Config:
    return on_site(show_config(3), path)


async def started(show: VirtualShow) -> None:
    """Start, once the fence was uploaded and read back."""
    await show.standby()
    await show.wait(5.0)
    await show.start()


def failing(show: VirtualShow) -> list[str]:
    return [check.name for check in show.service.preflight.report().fleet if not check.passes]


def test_no_start_is_possible_until_it_is_in_force(path: Path) -> None:
    async def change(show: VirtualShow) -> None:
        site = show.service.site
        stored = await site.read()
        with pytest.raises(InvalidError, match=r"the first formation|radius_m|height_max_m"):
            await site.change(write(field(top_m=8.0)), stored.version)
        changed = await site.change(write(HIGHER), stored.version)
        await show.standby()
        await show.wait(5.0)
        assert failing(show) == ["site in force"]
        with pytest.raises(RefusedError, match="not the one in force"):
            await show.start()
        view = show.service.view.value.features.site
        assert view is not None
        assert (view.version, view.hash) == (changed.version, SITE.digest)
        await site.change(write(SITE), changed.version)  # as it was
        await started(show)
        await show.reach(ShowPhase.RUNNING)

    fly(change, config(path))
    assert config(path).flight_site == SITE


@pytest.mark.soak
def test_the_next_start_flies_the_new_site(path: Path) -> None:
    async def change(show: VirtualShow) -> None:
        version = (await show.service.site.read()).version
        await show.service.site.change(write(HIGHER), version)

    fly(change, config(path))

    async def again(show: VirtualShow) -> None:
        assert (await show.service.site.read()).pending == ""
        await started(show)
        assert failing(show) == []

    flies = config(path)
    assert flies.flight_site == HIGHER
    assert flies.control.safety.fence.height_max_m == 55.0
    fly(again, flies)


@pytest.mark.soak
def test_nothing_is_changed_in_the_air(path: Path) -> None:
    async def change(show: VirtualShow) -> None:
        version = (await show.service.site.read()).version
        await started(show)
        await show.reach(ShowPhase.RUNNING)
        with pytest.raises(RefusedError, match="changed on the ground, and the show is running"):
            await show.service.site.change(write(HIGHER), version)

    fly(change, config(path))
    assert read_site(path) == SITE
