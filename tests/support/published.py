"""A vehicle on the wire that has the published parameters of one version, and nothing else."""

import asyncio
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.links import ParameterValue
from gcs.links.autopilots import AUTOPILOTS
from gcs.links.autopilots.versions import Version
from gcs.links.native.link import NativeLink
from gcs.model.frames import ShowFrame
from tests.support.memory_ports import MemoryPorts

DATA = Path(__file__).parents[1] / "data" / "autopilots"
RELEASED = 255
REQUEST_MESSAGE, REQUEST_CAPABILITIES, SET_INTERVAL = 512, 520, 511
UNSUPPORTED = 3
PERIOD_S = 0.02


@cache
def published(name: str) -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
    """Of one autopilot, by version: the published parameters."""
    lists: Mapping[str, Mapping[str, Mapping[str, Any]]] = json.loads((DATA / f"{name}.json").read_text())[
        "versions"
    ]
    return lists


def as_shipped(name: str, release: str) -> dict[str, ParameterValue]:
    """Values as delivered; 0 where none is published."""
    return {key: each.get("default", 0) for key, each in published(name)[release].items()}


class PublishedVehicle:
    """System 1 over a native link, on the ground. It answers for its parameters, and for its version or not.

    Attributes:
        set: names that were set, in order.
        commands: numbers of the commands that it received.
        number: MAV_AUTOPILOT of its heartbeats.
    """

    def __init__(
        self, name: str, values: Mapping[str, ParameterValue], version: int, *, knows_512: bool = True
    ) -> None:
        """`version` is its flight_sw_version; 0: it reports none."""
        clock = asyncio.get_running_loop().time
        self.ports, self.profile = MemoryPorts(clock), AUTOPILOTS[name]
        self.values, self.version, self.armed = dict(values), version, False
        self.set, self.commands = list[str](), list[int]()
        self._knows_512, self.number = knows_512, self.profile.number
        self.link = NativeLink(
            "one",
            {"d1": 1},
            (),
            ShowFrame(47.0, 8.0, 400.0),
            autopilots=(self.profile,),
            clock=clock,
            ports=self.ports,
        )

    async def live(self) -> None:
        """Answer until cancelled."""
        seen, beat_s, clock = 0, -1.0, asyncio.get_running_loop().time
        while True:
            if clock() - beat_s >= 1.0:
                beat_s = clock()
                base = 1 | 0x80 * self.armed
                self.ports.say(dialect.MAVLink_heartbeat_message(2, self.number, base, 0, 4, 3))
            for _, message in self.ports.sent[seen:]:
                self._answer(message)
            seen = len(self.ports.sent)
            await asyncio.sleep(PERIOD_S)

    def _answer(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            self.commands.append(message.command)
            known = {REQUEST_MESSAGE, REQUEST_CAPABILITIES} if self._knows_512 else {REQUEST_CAPABILITIES}
            if message.command in known and self.version:
                nothing = [0] * 8
                self.ports.say(
                    dialect.MAVLink_autopilot_version_message(
                        0, self.version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 1
                    )
                )
        elif kind == "PARAM_REQUEST_READ" and message.param_id in self.values:
            self._send(message.param_id)
        elif kind == "PARAM_SET" and message.param_id in self.values:
            raw = np.array([message.param_value], np.float32)
            value = self.profile.decoded(raw, message.param_type)
            self.values[message.param_id] = value
            self.set.append(message.param_id)
            self._send(message.param_id)

    def _send(self, name: str) -> None:
        raw, kind = self.profile.encoded(self.values[name])
        self.ports.say(dialect.MAVLink_param_value_message(name.encode(), raw[0], kind, len(self.values), 0))


def released(text: str) -> int:
    """flight_sw_version of a release such as "4.7"."""
    major, minor = map(int, text.split("."))
    number = major << 24 | minor << 16 | RELEASED
    assert str(Version.decoded(number)).startswith(text)
    return number
