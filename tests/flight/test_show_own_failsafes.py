"""Autopilots that intervene by themselves: recognised, named, left alone, or flown on."""

from typing import Any

import pytest

from gcs.failsafe.autopilot_failsafe import control_refusal
from gcs.links import Verb
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service.alarms import AlarmCause, AlarmSeverity
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from tests.support.show_phases import running

pytestmark = pytest.mark.soak


def config(count: int = 4, **sections: Any) -> Any:
    return show_config(count, operation=HOLDS_WHEN_LOST, **sections)


async def three_flat(show: VirtualShow) -> dict[str, Any]:
    await show.start()
    began_s = show.now_s
    for name in ("d1", "d2", "d3"):
        show.befall(name, "battery", remaining=0.05)
    await show.until(lambda: all(show.vehicle(name).phase is Phase.PILOT for name in ("d1", "d2", "d3")))
    await show.wait(0.5)
    held = {show.vehicle(name).reason.partition(" ")[2] for name in ("d1", "d2", "d3")}
    await show.until(lambda: all(" lands " in show.vehicle(name).reason for name in ("d1", "d2", "d3")), 8.0)
    await show.wait(0.5)
    alarms, reasons = show.view.alarms, [show.vehicle(name).reason for name in ("d1", "d2", "d3")]
    flight = show.service.flight
    refusals = [
        control_refusal(name, flight.inputs(flight.vehicles[name])) for name in ("d1", "d2", "d3", "d4")
    ]
    await show.until(lambda: all(show.vehicle(name).phase is Phase.STANDBY for name in ("d1", "d2", "d3")))
    landed_s = {name: show.track.between(began_s).since(name, Phase.STANDBY) for name in ("d1", "d2", "d3")}
    verbs = {
        name: [each.verb for each in show.ports.commands[name] if began_s < each.time_s < landed_s[name]]
        for name in ("d1", "d2", "d3")
    }
    return {
        "alarms": alarms,
        "held": held,
        "reasons": reasons,
        "refusals": refusals,
        "verbs": verbs,
        "violations": show.floor_violations(),
    }


def test_three_that_land_on_empty_batteries_are_named() -> None:
    found = fly(three_flat, config(), parameters={"COM_LOW_BAT_ACT": 2}, quirks=Quirks())
    assert found["held"] == {
        "holds for a few seconds first by its own critical-battery failsafe, battery 5%. Leave it."
    }
    assert found["reasons"] == [
        f"{name} lands by its own critical-battery failsafe, battery 5%. Leave it."
        for name in ("d1", "d2", "d3")
    ]
    (alarm,) = [each for each in found["alarms"] if each.cause is AlarmCause.OWN_FAILSAFE]
    assert set(alarm.vehicles) == {"d1", "d2", "d3"}
    assert alarm.text.endswith(
        " flown by an own failsafe: lands by its own critical-battery failsafe, battery 5%."
        " The service sends nothing to them."
    )
    assert (alarm.severity, alarm.advice) == (AlarmSeverity.EMERGENCY, "Leave them.")
    assert not [each for each in found["alarms"] if "take-control" in each.text + each.advice]
    assert all("critical below 10%" in refusal for refusal in found["refusals"][:3])
    assert found["refusals"][3] == ""
    assert set(map(tuple, found["verbs"].values())) <= {(), (Verb.OFFBOARD,)}, "nothing stops their landing"
    assert found["violations"] == 0


async def deaf(show: VirtualShow, seconds: float) -> tuple[list[Phase], str, list[ShowPhase]]:
    """Setpoints leave, and do not reach it; its telemetry arrives all the while."""
    began_s = show.now_s
    show.ports.silence("d2", down=False)
    await show.phase("d2", Phase.PILOT)
    reason = show.vehicle("d2").reason
    await show.wait(seconds)
    show.ports.restore("d2")
    await show.phase("d2", Phase.FORMATION, 30.0)
    await show.wait(0.2)  # until the track has it
    track = show.track.between(began_s)
    return track.phases("d2"), reason, track.show_phases()


@pytest.mark.soak
def test_hold_from_missed_setpoints_flies_on() -> None:
    phases, reason, shows = fly(lambda show: deaf(show, 8.0), config(), after=running)
    assert phases == [Phase.FORMATION, Phase.PILOT, Phase.HOLD, Phase.FORMATION]
    assert reason.startswith(
        "d2 holds by its own setpoint-loss failsafe: its link lost them, or its positions"
    )
    assert shows == [ShowPhase.RUNNING]


async def pilot_after_deaf(show: VirtualShow) -> tuple[list[Phase], str]:
    began_s = show.now_s
    show.ports.silence("d2", down=False)
    await show.phase("d2", Phase.PILOT)
    show.befall("d2", "pilot", mode="POSITION")
    await show.wait(3.0)
    show.ports.restore("d2")
    await show.wait(6.0)
    return show.track.between(began_s).phases("d2"), show.vehicle("d2").reason


@pytest.mark.soak
def test_failsafe_ended_by_a_pilot_stays_with_the_pilot() -> None:
    phases, reason = fly(pilot_after_deaf, config(), after=running)
    assert phases == [Phase.FORMATION, Phase.PILOT]
    assert "when the pilot agrees" in reason
