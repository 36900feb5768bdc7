"""A ground station for fake vehicles with ArduPilot in virtual time, by MAVLink frames as bytes."""

from __future__ import annotations

import copy
import gzip
import json
import math
from itertools import chain
from pathlib import Path
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.sim.autopilots.ardupilot.firmware import HEIGHT_SCALE
from gcs.sim.autopilots.ardupilot.modes import Mode
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.virtual_show import FLEET_STEP_S
from tests.support.sim_bench import ACCEPTED, Bench

ARDU_DATA = Path(__file__).parents[1] / "data" / "ardupilot" / "fake"
ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
STATION = 245
SET_INTERVAL = 511
MAGICS = (0xFE, 0xFD)
"""First bytes of frames."""
ASKED_HZ = {1: 2.0, 24: 2.0, 32: 10.0, 33: 10.0, 85: 5.0, 147: 2.0, 193: 2.0, 242: 2.0, 245: 10.0}
"""What a ground station asks for."""


class ArduBench(Bench):
    """Vehicles that are ready at once, unless `late`; their streams are asked for, unless not `asked`."""

    def __init__(
        self,
        step_s: float = FLEET_STEP_S,
        *,
        late: bool = False,
        asked: bool = True,
        scaled: bool = False,
        **settings: Any,
    ) -> None:
        """With `scaled` the reported height is as much too large as that of a real one."""
        self.console = b""
        self.over_true = HEIGHT_SCALE if scaled else 1.0
        quirks = Quirks().changed([("late-ready", late), ("height-scale", scaled)])
        super().__init__(step_s, autopilot="ardupilot", quirks=quirks, **settings)
        self._dialect = dialect.MAVLink(None)
        if asked:
            self.ask(ASKED_HZ)

    @property
    def custom_mode(self) -> int:
        """As the last HEARTBEAT has it."""
        return int(self.last("HEARTBEAT").custom_mode)

    @property
    def landed_state(self) -> int:
        return int(self.last("EXTENDED_SYS_STATE").landed_state)

    @property
    def texts(self) -> list[str]:
        """In the order in which they came; ArduPilot's have no number."""
        return [message.text for message in self.all("STATUSTEXT")]

    @property
    def height_m(self) -> float:
        return -self.truth[2]

    def ask(self, rates_hz: dict[int, float]) -> None:
        for vehicle in self.fleet.autopilots:
            for message_id, rate_hz in rates_hz.items():
                self.send(command(SET_INTERVAL, message_id, 1e6 / rate_hz, target=vehicle.system_id))

    def order(self, mode: Mode | int) -> list[int]:
        """DO_SET_MODE. Returns: the acknowledged results in order."""
        return self.command(176, 1, mode)

    def kill(self) -> list[int]:
        return self.command(400, 0, 21196)

    def rise(self, height_m: float = 10.0) -> Self:
        """GUIDED, arm, NAV_TAKEOFF; then hover at that height above home."""
        self.run(1.2)
        for mode in (self.order(Mode.GUIDED), self.arm(), self.command(22, 0, 0, 0, 0, 0, 0, height_m)):
            assert mode == [ACCEPTED]
        self.until(lambda: self.height_m * self.over_true > height_m - 0.3, 30.0)
        self.run(4.0)
        return self

    def cruise(self, speed_m_s: float = 5.0, height_m: float = 10.0) -> Self:
        """Fly north at that speed."""
        self.rise(height_m)
        self.stream(speed_m_s, 0.0, 0.0)
        self.run(9.0)
        return self

    def _receive(self, stated: dict[int, list[bytes]]) -> None:
        for frame in chain.from_iterable(stated.values()):
            if frame[0] in MAGICS:
                self.received.append((self.now_s, self._dialect.decode(bytearray(frame))))
            else:
                self.console += frame


def command(number: int, *values: float, target: int = 1, component: int = 1) -> Any:
    padded = [*values, *[0.0] * (7 - len(values))]
    return dialect.MAVLink_command_long_message(target, component, number, 0, *padded)


_led: dict[str, ArduBench] = {}
"""Benches that stand still where they were led to, by what led them."""


def _copied(maneuver: str, settings: dict[str, Any], **how: float) -> ArduBench:
    """A bench after the maneuver, which is flown once for all tests."""
    made_of = f"{maneuver} {how} {settings}"
    if made_of not in _led:
        _led[made_of] = getattr(ArduBench(**settings), maneuver)(**how)
    original = _led[made_of]
    return copy.deepcopy(original, {id(message): message for _, message in original.received})


def grounded(**settings: Any) -> ArduBench:
    """On the ground in GUIDED, ready to arm."""
    bench = ArduBench(**settings)
    bench.run(1.2)
    assert bench.order(Mode.GUIDED) == [ACCEPTED]
    bench.run(1.1)
    return bench


def hovering(height_m: float = 10.0, **settings: Any) -> ArduBench:
    """In GUIDED at that height, without setpoints."""
    return _copied("rise", settings, height_m=height_m)


def cruising(speed_m_s: float = 5.0, height_m: float = 10.0, **settings: Any) -> ArduBench:
    """In GUIDED, north at that speed; the setpoint goes on."""
    return _copied("cruise", settings, speed_m_s=speed_m_s, height_m=height_m)


def stop_m(bench: ArduBench, over_s: float = 8.0) -> tuple[float, float]:
    """Let it stop. Returns: the farthest point and the last one, north of where it is now."""
    begin_m = bench.truth[0]
    track_m = [bench.run(0.05).truth[0] - begin_m for _ in range(math.ceil(over_s / 0.05))]
    return max(track_m), track_m[-1]


def digest(name: str) -> dict[str, Any]:
    """A recorded session, see tests/data/ardupilot/fake/README.md."""
    return dict(json.loads(gzip.decompress((ARDU_DATA / f"digest_{name}.json.gz").read_bytes())))
