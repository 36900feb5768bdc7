"""Parameters, a fleet that loses us at once, jumps of position and reported accuracy, in a flying show."""

import asyncio
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pytest

from gcs.cli.params import ParameterRow, inspect
from gcs.links import ParameterValue
from gcs.model.errors import CommandError, RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation
from gcs.model.state import VehicleId
from gcs.service import ShowAction
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import (
    FLEET_STEP_S,
    HOLDS_WHEN_LOST,
    RefusedCall,
    VirtualShow,
    fly,
    refused,
    show_config,
)
from tests.support.show_phases import running

SAFE = {**HOLDS_WHEN_LOST, "require_safe_setpoint_loss": True}


async def start(show: VirtualShow) -> RefusedCall:
    return await refused(show, lambda: show.service.commands.command_show(ShowAction.START))


async def mended(show: VirtualShow) -> tuple[RefusedCall, bool]:
    """Wrong on d2; somebody sets it right; the next try finds it so."""
    await show.standby()
    first = await start(show)
    show.autopilot("d2").parameters.set("COM_OBL_RC_ACT", 5)
    await start(show)  # whoever is refused is read again
    await show.wait(0.5)
    show.service.commands.command_show(ShowAction.START)
    await show.reach(ShowPhase.ASSEMBLING)
    return first, True


def test_start_is_refused_for_a_wrong_parameter_until_fixed() -> None:
    async def story(show: VirtualShow) -> tuple[RefusedCall, bool]:
        await show.until(lambda: show.vehicle("d2").phase is Phase.STANDBY)
        show.autopilot("d2").parameters.set("COM_OBL_RC_ACT", 0)
        await show.wait(2.0)  # so that its clock has somewhere to jump back from
        show.befall("d2", "reboot", off_s=0.0)  # all is read again
        await show.until(lambda: not show.vehicle("d2").ready)
        return await mended(show)

    refusal, flies = fly(story, show_config(3, operation=HOLDS_WHEN_LOST), step_s=FLEET_STEP_S)
    assert refusal.kind is RefusedError
    assert refusal.text.startswith("d2: COM_OBL_RC_ACT is 0, 5 is needed")
    assert "gcs params apply --config FILE" in refusal.text
    assert flies


def test_px4_defaults_are_refused() -> None:
    async def story(show: VirtualShow) -> RefusedCall:
        await show.standby()
        return await start(show)

    delivered = {"COM_OBL_RC_ACT": 0, "COM_RC_OVERRIDE": 1, "GF_MAX_HOR_DIST": 0.0, "GF_MAX_VER_DIST": 0.0}
    text = fly(story, show_config(2, operation=HOLDS_WHEN_LOST), parameters=delivered).text
    for name in delivered:
        assert text.count(f"d1, d2: {name} is") == 1, "what is true of all is said once"


@pytest.mark.soak
def test_vehicle_with_unreadable_parameters_is_not_flown() -> None:
    async def story(show: VirtualShow) -> tuple[RefusedCall, bool, bool]:
        async def no_answer(vehicle_id: str, names: object, may_lack: object = ()) -> dict[str, float]:
            raise CommandError(f"{vehicle_id}: parameter GF_ACTION: no answer")

        show.link.read_parameters = no_answer  # type: ignore[method-assign]
        await show.wait(9.0)
        refusal = await start(show)
        ready = show.vehicle("d1").ready
        del show.link.read_parameters
        await show.until(lambda: show.vehicle("d1").ready, 5.0)
        return refusal, ready, show.vehicle("d1").ready

    refusal, before, after = fly(story, show_config(2))
    assert "d1: parameters not read yet: d1: parameter GF_ACTION: no answer" in refusal.text
    assert (before, after) == (False, True)


@pytest.mark.soak
def test_slow_reading_ends_while_readiness_is_asked_for() -> None:
    """An autopilot without some of the parameters takes 2 s for each of them."""

    async def story(show: VirtualShow) -> bool:
        read = show.link.read_parameters

        async def slowly(
            vehicle_id: VehicleId, names: Sequence[str], may_lack: Collection[str] = ()
        ) -> Mapping[str, ParameterValue]:
            await asyncio.sleep(6.0)
            return await read(vehicle_id, names, may_lack)

        show.link.read_parameters = slowly  # type: ignore[method-assign]
        for _ in range(40):
            if show.service.preflight.report().passes:
                return True
            await show.wait(0.5)
        return False

    assert fly(story, show_config(1))


@pytest.mark.soak
def test_parameters_are_read_on_discovery_reboot_and_landing() -> None:
    async def story(show: VirtualShow) -> list[int]:
        counts = []
        await show.start()
        counts.append(show.ports.reads())
        await show.wait(5.0)
        counts.append(show.ports.reads())
        await show.show(ShowAction.STOP)
        await show.wait(1.0)
        counts.append(show.ports.reads())
        show.befall("d1", "reboot", off_s=0.0)
        await show.until(lambda: not show.vehicle("d1").ready)
        await show.standby()
        await show.wait(1.0)
        counts.append(show.ports.reads())
        return counts

    assert fly(story, show_config(2)) == [2, 2, 4, 5]


@pytest.mark.soak
def test_without_required_parameters_none_is_read_and_all_fly() -> None:
    async def story(show: VirtualShow) -> int:
        await show.standby()
        show.service.commands.command_show(ShowAction.START)
        await show.reach(ShowPhase.ASSEMBLING)
        return show.ports.reads()

    operation = {"require_parameters": False}
    assert fly(story, show_config(2, operation=operation), parameters={"COM_OBL_RC_ACT": 3}) == 0


def test_start_is_refused_when_setpoint_loss_would_collide() -> None:
    async def story(show: VirtualShow) -> RefusedCall:
        await show.standby()
        return await start(show)

    refusal = fly(story, show_config(4, operation={"require_safe_setpoint_loss": True}))
    assert refusal.kind is RefusedError
    assert "if all vehicles lost this ground station at once, 'descend' would bring d" in refusal.text
    assert "'hold' would keep them apart" in refusal.text


@pytest.mark.soak
def test_vehicles_holding_after_control_ends_stay_apart() -> None:
    """What was predicted is what happens: the service stops, and no vehicle comes inside the floor."""

    async def story(show: VirtualShow) -> tuple[int, list[str]]:
        await show.start()
        await show.wait(5.0)
        show.ports.silence(*show.config.ids)
        await show.wait(12.0)
        modes = [pilot.commander.mode.name for pilot in show.fleet.autopilots]
        return show.floor_violations(), modes

    violations, modes = fly(story, show_config(4, operation=SAFE))
    assert violations == 0
    assert modes == ["HOLD"] * 4


async def params(show: VirtualShow, *names: str, apply: bool) -> dict[tuple[str, str], ParameterRow]:
    rows = await inspect(
        [show.link], show.config, names or show.config.ids, 3.0, named=bool(names), apply=apply
    )
    return {(row.vehicle, row.parameter): row for row in rows}


def test_params_check_reports_and_apply_sets_and_reads_back() -> None:
    async def story(show: VirtualShow) -> tuple[ParameterRow, ParameterRow, ParameterRow, float]:
        before = await params(show, apply=False)
        during = await params(show, apply=True)
        after = await params(show, apply=False)
        assert all(row.good for row in (*during.values(), *after.values()))
        key = ("d2", "COM_OBL_RC_ACT")
        return before[key], during[key], after[key], show.autopilot("d2").parameters[key[1]]

    before, during, after, held = fly(
        story, show_config(2, operation=HOLDS_WHEN_LOST), parameters={"COM_OBL_RC_ACT": 0}
    )
    assert (before.value, before.desired, before.good) == (0, "5", False)
    assert before.verdict.startswith("wrong: what it does without setpoints")
    assert (during.value, during.verdict) == (5, "set")
    assert (after.value, after.verdict) == (5, "ok")
    assert held == 5


@pytest.mark.soak
def test_params_apply_never_touches_an_armed_vehicle() -> None:
    async def story(show: VirtualShow) -> tuple[ParameterRow, float]:
        show.autopilot("d1").parameters.set("COM_OBL_RC_ACT", 3)
        rows = await params(show, "d1", apply=True)
        key = "COM_OBL_RC_ACT"
        return rows["d1", key], show.autopilot("d1").parameters[key]

    row, held = fly(story, show_config(2), after=running)
    assert row.verdict == "wrong, and not set: the vehicle is armed"
    assert held == 3


@pytest.mark.soak
def test_params_of_a_named_vehicle_that_is_not_received() -> None:
    async def story(
        show: VirtualShow,
    ) -> tuple[dict[tuple[str, str], ParameterRow], dict[tuple[str, str], ParameterRow]]:
        show.ports.silence("d2")
        return await params(show, "d1", "d2", apply=False), await params(show, apply=False)

    named, unnamed = fly(story, show_config(2))
    assert named["d2", "-"].verdict == "not received within 3 s"
    assert not named["d2", "-"].good
    assert {vehicle for vehicle, _ in unnamed} == {"d1"}


@pytest.mark.soak
def test_jumping_position_lists_first_and_widens_the_margin() -> None:
    async def story(show: VirtualShow) -> tuple[list[float], list[float], list[Phase], str, str]:
        await show.wait(10.0)
        show.befall("d2", "gps-jump", north_m=3.0)
        jumped_s = show.now_s
        await show.wait(2.5)
        reason = show.vehicle("d2").reason
        speeds_m_s = [
            float(np.linalg.norm(seen.setpoint_m_s or (0.0, 0.0, 0.0)))
            for seen in show.track.between(jumped_s + 1.5).of("d2")
        ]
        wide_m = [seen.position_uncertainty_m for seen in vehicles_of(show.view)]
        await show.wait(40.0)
        later_m = [seen.position_uncertainty_m for seen in vehicles_of(show.view)]
        show.befall("d3", "position-reset", east_m=0.5)
        await show.wait(1.5)
        small = show.vehicle("d3").reason
        return [max(speeds_m_s), *wide_m], later_m, show.track.phases("d2"), reason, small

    (fastest_m_s, *wide_m), later_m, phases, reason, small = fly(story, show_config(3), after=running)
    assert reason.startswith("its position jumped: it stands for 3 s")
    assert fastest_m_s < 1.5
    jumped_m, *others_m = wide_m[1], wide_m[0], wide_m[2]
    assert others_m == pytest.approx([0.225, 0.225])
    floor = show_config(3).control.safety.floor
    grown_m = floor.reserve_m(jumped_m, 0.225) - floor.reserve_m(0.225, 0.225)
    assert grown_m == pytest.approx(3.0, abs=0.2), "others keep clear of both places"
    assert later_m == pytest.approx([0.225] * 3)
    assert phases[-1] is Phase.FORMATION, "it goes on by itself"
    assert small.startswith("its position jumped: it stands for 3 s"), "the estimator reported the jump"


@pytest.mark.soak
def test_reported_accuracy_widens_the_margin_within_bounds() -> None:
    """A vehicle that reports a poor accuracy stays on the ground."""

    async def story(show: VirtualShow) -> tuple[list[float], RefusedCall, RefusedCall]:
        await show.standby()
        show.befall("d1", "accuracy", eph_m=1.0, epv_m=1.8)
        await show.wait(0.6)  # it is reported twice a second
        smaller = await refused(show, lambda: show.service.plan.set_formation(Formation(5.5, 14.0)))
        show.befall("d2", "accuracy", eph_m=9.0, epv_m=20.0)
        await show.wait(0.6)
        return [seen.position_uncertainty_m for seen in vehicles_of(show.view)], smaller, await start(show)

    wide_m, smaller, refusal = fly(
        story, show_config(3, positioning={"share": 1.0}), spacing_m=22.0, ideal=True
    )
    assert wide_m == pytest.approx([1.0, 3.0, 0.05])
    assert "at least 9.0 m for 3 vehicles 15.5 m apart" in smaller.text
    assert "uncertain by 1.00 m (1 sigma); 2.5 m is enough at 0.05 m, as with RTK" in smaller.text
    assert refusal.text.startswith("1. d2: its receiver reports an accuracy of 9.0 m sideways and 20.0 m up")
    assert "d1" not in refusal.text
