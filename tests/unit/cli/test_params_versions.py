"""`gcs params` on the wire, with a vehicle of each supported version as delivered, and of others."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import async_solipsism
import pytest

from gcs.cli import params
from gcs.cli.params import LACKING, OPEN, ParameterRow, inspect
from gcs.config.schema import Config
from gcs.links import ParameterValue
from gcs.links.autopilots import AUTOPILOTS
from gcs.testing.virtual_show import show_config
from tests.support.published import PublishedVehicle, as_shipped, published, released

ALL = [(name, str(release)) for name, profile in AUTOPILOTS.items() for release in profile.versions.versions]
HOLDS = {"setpoint_loss_action": "hold"}


def config_of(name: str) -> Config:
    raw = show_config(1, operation=HOLDS).model_dump()
    raw["links"][0]["autopilot"] = name
    raw["links"][0]["vehicles"] = [{"id": "d1", "system_id": 1}]
    return Config.model_validate(raw)


def on_wire(
    vehicle: Callable[[], PublishedVehicle], story: Callable[[PublishedVehicle], Coroutine[Any, Any, Any]]
) -> Any:
    """Play a story with a vehicle that lives, in virtual time."""

    async def main() -> Any:
        one = vehicle()
        tasks = [asyncio.create_task(each) for each in (one.live(), one.link.run())]
        result = await story(one)
        for task in tasks:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
        return result

    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        return runner.run(main())


def inspected(
    name: str, values: dict[str, ParameterValue], version: int, *, knows_512: bool = True
) -> tuple[PublishedVehicle, list[ParameterRow], list[ParameterRow], float]:
    """The vehicle, the rows of `apply` and of a `check` after it, and how long both took."""
    config = config_of(name)

    async def story(
        one: PublishedVehicle,
    ) -> tuple[PublishedVehicle, list[ParameterRow], list[ParameterRow], float]:
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        applied = await inspect([one.link], config, ("d1",), 8.0, named=True, apply=True)
        checked = await inspect([one.link], config, ("d1",), 8.0, named=True, apply=False)
        return one, applied, checked, loop.time() - began_s

    return on_wire(lambda: PublishedVehicle(name, values, version, knows_512=knows_512), story)  # type: ignore[no-any-return]


@pytest.mark.parametrize(("name", "release"), ALL)
def test_apply_and_then_check_pass_as_delivered(name: str, release: str) -> None:
    one, applied, checked, took_s = inspected(name, as_shipped(name, release), released(release))
    wrong = [row for row in (*applied, *checked) if not row.good]
    assert wrong == []
    assert set(one.set) == {row.parameter for row in applied if row.verdict == "set"}
    assert len(one.set) > 3
    assert {row.parameter for row in applied if not row.verdict.startswith(LACKING)} <= set(
        published(name)[release]
    )
    assert took_s < 12.0, "no name of another version was waited for"


@pytest.mark.parametrize(
    ("name", "release"), [("px4", "1.16"), ("px4", "1.18"), ("ardupilot", "4.0"), ("ardupilot", "4.7")]
)
def test_without_a_version_the_names_tell(name: str, release: str) -> None:
    _, applied, checked, took_s = inspected(name, as_shipped(name, release), 0)
    assert [row for row in (*applied, *checked) if not row.good] == []
    assert applied[0].parameter == "version"
    assert applied[0].verdict.startswith(f"{OPEN}: its version is not known")
    assert took_s < 30.0, "names that it may lack are waited for together"


def test_old_autopilot_is_asked_by_the_old_command() -> None:
    one, applied, _, _ = inspected(
        "ardupilot", as_shipped("ardupilot", "4.0"), released("4.0"), knows_512=False
    )
    assert one.commands[:2] == [512, 520]
    assert "version" not in {row.parameter for row in applied}


def test_newer_version_is_set_and_named() -> None:
    _, applied, checked, _ = inspected("ardupilot", as_shipped("ardupilot", "4.7"), released("4.8"))
    assert all(row.good for row in (*applied, *checked))
    assert checked[0].verdict.startswith(
        f"{OPEN}: it has ArduCopter 4.8.0, newer than what this station knows"
    )


def test_parameter_that_a_newer_version_lacks_is_refused_by_name() -> None:
    values = as_shipped("ardupilot", "4.7")
    del values["WP_ACC"]
    _, applied, _, _ = inspected("ardupilot", values, released("4.8"))
    (row,) = (row for row in applied if not row.good)
    assert (row.parameter, row.verdict) == ("WP_ACC", params.MISSING)
    assert row.to_do.startswith("update the station, or fly ArduCopter 4.0 to 4.7: ArduCopter 4.8.0 is newer")


def test_too_old_a_version_is_refused_and_nothing_is_set() -> None:
    one, applied, _, _ = inspected("px4", as_shipped("px4", "1.14"), released("1.13"))
    (row,) = applied
    assert row.verdict == "it has PX4 1.13.0, PX4 1.14 to 1.18 can be flown"
    assert row.to_do == "update its firmware"
    assert one.set == []


def test_another_autopilot_than_configured_is_refused_as_such() -> None:
    async def story(one: PublishedVehicle) -> list[ParameterRow]:
        one.number = 3
        return await inspect([one.link], config_of("px4"), ("d1",), 8.0, named=True, apply=True)

    vehicle = partial(PublishedVehicle, "px4", as_shipped("px4", "1.16"), released("4.7"))
    (row,) = on_wire(vehicle, story)
    assert row.verdict == "it reports ArduPilot, and is configured as PX4 (autopilot: px4)"
    assert row.to_do == "correct autopilot in the configuration, of the vehicle or its link"


@pytest.mark.parametrize(
    ("rows", "advice"),
    [
        (
            [ParameterRow("d1", "A", 1, "2", "wrong: x", params.APPLY)],
            "to mend this: gcs params apply --config show.yaml",
        ),
        ([ParameterRow("d1", "A", None, "2", params.MISSING, "install it")], "to mend this: install it"),
        ([ParameterRow("d1", "A", 2, "2", "ok")], ""),
    ],
    ids=["wrong", "missing", "good"],
)
def test_advice_is_what_helps(rows: Sequence[ParameterRow], advice: str) -> None:
    assert params.advice(rows, "show.yaml") == advice
