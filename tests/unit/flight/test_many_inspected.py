"""All vehicles of a fleet need attention at once: what changed is seen at once, the rest in turn."""

import asyncio
from dataclasses import replace
from math import ceil

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.failsafe.autopilot_failsafe import FailsafeCause
from gcs.flight.composition import landing_places_of, maneuvers_of
from gcs.flight.monitors.telemetry_monitor import AT_ONCE_MAX, TelemetryMonitor
from gcs.flight.state.flight import Flight
from gcs.flight.state.vehicle import Vehicle
from gcs.model.lifecycle import Phase
from gcs.model.state import Landed, Mode, Telemetry, VehicleId
from tests.support.silent_link import SilentLink

COUNT, TICK_S = 245, 0.05
TURNS = ceil(COUNT / AT_ONCE_MAX)


class InTheAir(SilentLink):
    """Vehicles that were flying when this station started, all of them received in every tick."""

    def __init__(self, ids: tuple[VehicleId, ...]) -> None:
        super().__init__(ids)
        self.now_s, self.battery = 10.0, 0.6
        self.modes, self.armed = [Mode.RETURN] * COUNT, [True] * COUNT

    def snapshot(self) -> Telemetry:
        """At `now_s`."""
        now_s, place_deg = np.full(COUNT, self.now_s), np.linspace(0.0, 0.02, COUNT)
        return replace(
            super().snapshot(),
            position_time_s=now_s,
            heartbeat_time_s=now_s.copy(),
            life_time_s=now_s.copy(),
            latitude_deg=place_deg + 47.0,
            longitude_deg=place_deg + 8.0,
            altitude_amsl_m=np.full(COUNT, 402.0),
            velocity_ned_m_s=np.zeros((COUNT, 3)),
            battery_remaining=np.full(COUNT, self.battery),
            mode=tuple(self.modes),
            armed=tuple(self.armed),
            in_failsafe=(True,) * COUNT,
            landed=(Landed.IN_AIR,) * COUNT,
        )


class Scene:
    """The monitor of such a fleet, ticked by hand."""

    def __init__(self) -> None:
        config = Config.model_validate(
            {
                "show_frame": {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_amsl_m": 400.0},
                "links": [{"name": "none", "listen": "udpin://127.0.0.1:1", "vehicles": {"count": COUNT}}],
                "formation": {"radius_m": 30.0, "height_m": 40.0},
            }
        )
        self.link = InTheAir(config.ids)
        self.flight = Flight(config, [self.link], 0.0)
        maneuvers = maneuvers_of(self.flight, asyncio.TaskGroup(), landing_places_of(self.flight))
        self.monitor = TelemetryMonitor(
            self.flight.newest,
            self.flight.vehicles,
            self.flight.links,
            config,
            self.flight.table,
            self.flight.note_seen,
            lambda: self.flight.elsewhere.owned,
            self.flight.inputs,
            maneuvers,
            maneuvers.hold,
        )
        self.vehicles = [*self.flight.vehicles.values()]

    def tick(self) -> None:
        """One tick later, all vehicles received again."""
        self.link.now_s += TICK_S
        self.flight.receive(self.link.now_s)
        self.flight.note_setpoints()
        self.monitor.look()

    def of_cause(self, cause: FailsafeCause) -> list[Vehicle]:
        return [vehicle for vehicle in self.vehicles if vehicle.cause is cause]


@pytest.fixture
def scene() -> Scene:
    made = Scene()
    for _ in range(1 + TURNS):
        made.tick()
    return made


def test_all_vehicles_are_known_after_the_first_tick() -> None:
    scene = Scene()
    scene.tick()
    assert scene.flight.vehicles.phases == [Phase.PILOT] * COUNT


def test_each_vehicle_is_explained_anew_when_its_turn_comes(scene: Scene) -> None:
    assert TURNS > 1, "the fleet is too small to show it"
    scene.link.battery = 0.05
    scene.tick()
    assert len(scene.of_cause(FailsafeCause.CRITICAL_BATTERY)) == AT_ONCE_MAX
    for _ in range(1, TURNS):
        scene.tick()
    assert len(scene.of_cause(FailsafeCause.CRITICAL_BATTERY)) == COUNT


@pytest.mark.parametrize("row", [0, COUNT // 2, COUNT - 1])
def test_a_change_is_seen_in_its_own_tick(scene: Scene, row: int) -> None:
    scene.link.armed[row] = False
    scene.tick()
    assert scene.vehicles[row].phase is Phase.STANDBY


def test_a_silence_of_all_is_seen_in_its_own_tick(scene: Scene) -> None:
    silence_s = scene.flight.config.operation.silence_s
    scene.flight.receive(scene.link.now_s + silence_s + 10.0)
    scene.monitor.look()
    assert scene.flight.vehicles.phases == [Phase.LOST] * COUNT
