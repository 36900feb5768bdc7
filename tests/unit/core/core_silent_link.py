"""A link for tests of what needs one, but nobody on it."""

import asyncio

import numpy as np

from gcs.links import Order
from gcs.state import Landed, Mode, Setpoints, Telemetry, VehicleId


class SilentLink:
    """A link on which nobody is ever heard."""

    name = "none"
    setpoints_sent = 0

    def __init__(self, ids: tuple[VehicleId, ...]) -> None:
        self.ids = ids
        self.conflicts: dict[VehicleId, str] = {}

    async def run(self) -> None:
        """Nothing to do."""
        await asyncio.Event().wait()

    def snapshot(self) -> Telemetry:
        """Nothing was ever heard."""
        n = len(self.ids)
        return Telemetry(
            ids=self.ids,
            position_time_s=np.full(n, -np.inf),
            heartbeat_time_s=np.full(n, -np.inf),
            latitude_deg=np.full(n, np.nan),
            longitude_deg=np.full(n, np.nan),
            altitude_amsl_m=np.full(n, np.nan),
            velocity_ned_m_s=np.full((n, 3), np.nan),
            yaw_deg=np.full(n, np.nan),
            battery_remaining=np.full(n, np.nan),
            armed=(False,) * n,
            mode=(Mode.UNKNOWN,) * n,
            landed=(Landed.UNKNOWN,) * n,
            ready=(False,) * n,
        )

    def send(self, setpoints: Setpoints) -> None:
        """Nobody there."""

    async def execute(self, order: Order) -> None:
        """Nobody there."""
