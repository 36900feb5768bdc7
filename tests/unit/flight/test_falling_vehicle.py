"""A killed ArduCopter reports ON_GROUND at 22 m, falling: it is on the ground when it lies there."""

from gcs.config.schema import Config
from gcs.flight.state.flight import Flight
from gcs.links.autopilots import AUTOPILOTS
from gcs.links.native.link import NativeLink
from gcs.model.lifecycle import Event, Phase
from gcs.model.state import Landed, Whereabouts
from tests.support.tlog_files import frames, read

CONFIG = Config.model_validate(
    {
        "show_frame": {"latitude_deg": 47.397742, "longitude_deg": 8.545594, "altitude_amsl_m": 488.0},
        "links": [
            {
                "name": "none",
                "listen": "udpin://127.0.0.1:1",
                "transport": "native",
                "autopilot": "ardupilot",
                "vehicles": [{"id": "d2", "system_id": 2}],
            }
        ],
        "formation": {"radius_m": 10.0, "height_m": 20.0},
    }
)
KILLED_S = 0.9
FELL_S = 2.7


def test_killed_ardupilot_is_on_the_ground_when_it_lies_there() -> None:
    link = NativeLink("none", {"d2": 2}, (), CONFIG.frame, autopilots=(AUTOPILOTS["ardupilot"],))
    flight = Flight(CONFIG, (link,), 0.0)
    vehicle = flight.vehicles.named("d2")
    seen: list[tuple[float, Landed, Whereabouts, float]] = []
    for time_s, frame in frames("ardupilot/kill.tlog.xz"):
        reported = link._telemetry
        read(reported, time_s, frame)
        if time_s > KILLED_S and vehicle.phase is not Phase.KILLED:
            vehicle.phase = Phase.STANDBY
            vehicle.apply(Event.KILL, "motors stopped on command")
        flight.receive(time_s)
        seen.append(
            (
                time_s,
                Landed(int(reported.landed[0])),
                flight.newest.whereabouts(vehicle),
                flight.newest.position_m(vehicle)[2],
            )
        )
    falling = [each for each in seen if each[0] > KILLED_S and each[1] is Landed.ON_GROUND and each[3] < -3.0]
    assert falling, "it reports the ground while it falls"
    assert not any(where is Whereabouts.ON_GROUND for _, _, where, _ in falling)
    lies = [where for time_s, _, where, _ in seen if time_s > KILLED_S + FELL_S + 1.0]
    assert lies[-1] is Whereabouts.ON_GROUND
