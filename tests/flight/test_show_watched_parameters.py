"""Parameters that preflight demands are watched: another station that changes one is noticed at once."""

from typing import NamedTuple

import pytest

from gcs.links import ParameterValue
from gcs.model.errors import RefusedError
from gcs.service import ShowAction
from gcs.service.alarms import Alarm, AlarmCause
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, refused, show_config
from tests.support.show_phases import running


class Changed(NamedTuple):
    alarms: tuple[Alarm, ...]
    refusal: str
    after: tuple[Alarm, ...]


def of_parameters(show: VirtualShow) -> tuple[Alarm, ...]:
    return tuple(
        alarm for alarm in show.view.alarms if alarm.cause is AlarmCause.PARAMETER_CHANGED and alarm.lasts
    )


async def another_station_sets(show: VirtualShow, name: str, value: ParameterValue) -> None:
    """PX4 tells every station what one of them has set."""
    await show.link.set_parameter("d2", name, value)
    await show.wait(1.0)


async def changed_in_flight(show: VirtualShow) -> Changed:
    await another_station_sets(show, "MPC_YAWRAUTO_MAX", 40.0)  # preflight demands nothing of it
    assert of_parameters(show) == ()
    await another_station_sets(show, "COM_OF_LOSS_T", 5.0)
    alarms = of_parameters(show)
    await show.show(ShowAction.STOP)
    await show.standby()
    refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
    await another_station_sets(show, "COM_OF_LOSS_T", 1.0)
    await show.wait(1.0)
    after = of_parameters(show)
    show.service.commands.command_show(ShowAction.START)
    return Changed(alarms, refusal.text, after)


@pytest.mark.soak
def test_parameter_changed_in_flight_raises_an_alarm() -> None:
    changed = fly(changed_in_flight, show_config(3, operation=HOLDS_WHEN_LOST), after=running)
    (alarm,) = changed.alarms
    assert alarm.vehicles == ("d2",)
    assert "COM_OF_LOSS_T was changed from 1 to 5 in flight, 0.5 to 1 s is needed" in alarm.text
    assert "d2: COM_OF_LOSS_T is 5, 0.5 to 1 s is needed" in changed.refusal
    assert changed.after == ()


async def changed_on_the_ground(show: VirtualShow) -> tuple[tuple[Alarm, ...], str, int]:
    await show.standby()
    reads = show.ports.reads()
    await another_station_sets(show, "COM_OBL_RC_ACT", 0)
    refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
    return of_parameters(show), refusal.text, show.ports.reads() - reads


def test_parameter_changed_on_the_ground_fails_preflight() -> None:
    alarms, refusal, reads = fly(changed_on_the_ground, show_config(3, operation=HOLDS_WHEN_LOST))
    assert "COM_OBL_RC_ACT was changed from 5 to 0 on the ground, 5 is needed" in alarms[0].text
    assert "d2: COM_OBL_RC_ACT is 0, 5 is needed" in refusal
    assert reads <= 1, "at most by the refusal itself"


async def changed_while_read(show: VirtualShow) -> tuple[tuple[Alarm, ...], str]:
    """A refused start begins a read; a parameter is set once its old value was read."""
    await show.standby()
    await another_station_sets(show, "COM_OF_LOSS_T", 5.0)
    second, last = show.ports.reads("COM_OF_LOSS_T"), show.ports.reads("GF_MAX_VER_DIST")
    with pytest.raises(RefusedError):
        show.service.commands.command_show(ShowAction.START)
    for _ in range(1000):
        if show.ports.reads("COM_OF_LOSS_T") > second:
            break
        await show.wait(0.002)
    await show.link.set_parameter("d2", "COM_OBL_RC_ACT", 0)
    assert show.ports.reads("GF_MAX_VER_DIST") == last, "the others are still being read"
    await show.wait(2.0)
    assert show.ports.reads("GF_MAX_VER_DIST") == last + 1, "the read that began before"
    refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
    return of_parameters(show), refusal.text


@pytest.mark.soak
def test_parameter_set_while_others_are_read_is_kept() -> None:
    alarms, refusal = fly(changed_while_read, show_config(3, operation=HOLDS_WHEN_LOST))
    assert "d2: COM_OBL_RC_ACT is 0, 5 is needed" in refusal
    assert any("COM_OBL_RC_ACT was changed from 5 to 0 on the ground" in alarm.text for alarm in alarms)
