"""What a kill without the service reads: records and configurations, as a flight understands them."""

from pathlib import Path

import pytest

from gcs.cli.kill.plan import links_in, links_of, plan_of
from gcs.cli.kill.ports import ports_of
from gcs.config import schema as configuration
from gcs.config.yaml_files import CONFIGURATIONS
from gcs.links.settings import SPARE_ID
from gcs.model.errors import ConfigError, GcsError, RefusedError, UnknownError

LINK = {"name": "far", "listen": "udpin://127.0.0.1:14540", "vehicles": [{"id": "d1", "system_id": 1}]}


@pytest.mark.parametrize("name", [path.stem for path in CONFIGURATIONS.shipped()])
def test_links_are_those_of_the_checked_configuration(name: str) -> None:
    config = configuration.load(configuration.find(name))
    for raw in (links_in(name), links_of(config.model_dump(mode="json"), "the record")):
        assert [link.name for link in raw] == [link.name for link in config.links]
        for link, checked in zip(raw, config.links, strict=True):
            assert dict(link.system_ids) == {each.id: each.system_id for each in checked.fleet}
            assert link.station_id == checked.station_id
            assert len(ports_of(link)) >= len(checked.places)


def test_station_id_is_no_id_of_a_vehicle() -> None:
    (link,) = links_of({"links": [LINK | {"vehicles": [{"id": "d1", "system_id": 245}]}]}, "test")
    assert link.station_id == SPARE_ID


def test_record_that_cannot_be_read_names_the_option(tmp_path: Path) -> None:
    with pytest.raises(GcsError, match=r"there is no such file.*--config FILE"):
        plan_of(tmp_path)
    (tmp_path / "audit.sqlite").write_bytes(b"junk" * 4096)
    with pytest.raises(GcsError, match=r"not an audit that can be read.*--config FILE"):
        plan_of(tmp_path)


def test_configuration_serves_without_a_record(tmp_path: Path) -> None:
    (tmp_path / "audit.sqlite").write_bytes(b"junk" * 4096)
    plan = plan_of(tmp_path, links_of({"links": [LINK]}, "test"), "test")
    assert plan.chosen([]) == plan.chosen(["d1", "d1"]) == ["d1"]
    assert plan.stopped_since(0.0) == set()
    with pytest.raises(UnknownError, match="no such vehicle: d9; there are d1"):
        plan.chosen(["d9"])


def test_unusable_links_are_named() -> None:
    for raw in (
        {},
        {"links": [{"name": "far"}]},
        {"links": 5},
        {"links": [LINK | {"vehicles": {"count": "x"}}]},
    ):
        with pytest.raises(ConfigError, match="test: its links cannot be read"):
            links_of(raw, "test")


def test_record_without_a_vehicle_refuses_all(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, links_of({"links": [LINK]}, "test"))
    assert plan.chosen([]) == ["d1"], "nothing says that it was never received"
    with pytest.raises(RefusedError, match="no vehicle was ever received"):
        type(plan)("test", plan.links, {}, tmp_path).chosen([])
