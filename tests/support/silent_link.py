"""A link without vehicles, for tests that need one."""

import asyncio
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from gcs.links import Command, ParameterValue
from gcs.links.link import Address
from gcs.model.errors import CommandError
from gcs.model.state import Landed, Mode, Setpoints, Telemetry, VehicleId


class SilentLink:
    """A link on which no vehicle is ever received."""

    name = "none"
    setpoints_sent = 0

    def __init__(self, ids: tuple[VehicleId, ...]) -> None:
        self.ids = ids
        self.conflicts: dict[VehicleId, str] = {}
        self.problems: tuple[str, ...] = ()
        self.addresses: dict[VehicleId, Address] = {}

    async def run(self) -> None:
        """Nothing to do."""
        await asyncio.Event().wait()

    def snapshot(self) -> Telemetry:
        """Nothing was ever received."""
        n = len(self.ids)
        return Telemetry(
            ids=self.ids,
            position_time_s=np.full(n, -np.inf),
            heartbeat_time_s=np.full(n, -np.inf),
            life_time_s=np.full(n, -np.inf),
            latitude_deg=np.full(n, np.nan),
            longitude_deg=np.full(n, np.nan),
            altitude_amsl_m=np.full(n, np.nan),
            velocity_ned_m_s=np.full((n, 3), np.nan),
            yaw_deg=np.full(n, np.nan),
            battery_remaining=np.full(n, np.nan),
            armed=(False,) * n,
            mode=(Mode.UNKNOWN,) * n,
            in_failsafe=(False,) * n,
            landed=(Landed.UNKNOWN,) * n,
            ready=(False,) * n,
            horizontal_accuracy_m=np.full(n, np.nan),
            vertical_accuracy_m=np.full(n, np.nan),
            reboot_count=(0,) * n,
            position_resets=(0,) * n,
            fix_type=np.full(n, np.nan),
            unhealthy_sensors=np.full(n, -1),
            clock_base_s=np.full(n, np.nan),
            texts=((),) * n,
        )

    def send(self, setpoints: Setpoints) -> None:
        """No vehicle answers."""

    def watch_parameters(self, names: Collection[str]) -> None:
        """No vehicle answers."""

    def reported_parameters(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        """No vehicle answers."""
        return {}

    async def execute(self, command: Command) -> None:
        """No vehicle answers."""

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str]
    ) -> Mapping[str, ParameterValue]:
        """No vehicle answers."""
        raise CommandError(f"{vehicle_id}: its parameters cannot be read: never received on link {self.name}")

    async def set_parameter(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """No vehicle answers."""
        raise CommandError(f"{vehicle_id}: {name} cannot be set: never received on link {self.name}")
