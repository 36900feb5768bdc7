"""A link without vehicles, for tests that need one."""

from gcs.links.native.link import NativeLink
from gcs.model.frames import ShowFrame
from gcs.model.state import VehicleId


class SilentLink(NativeLink):
    """A link without ports, on which no vehicle is ever received."""

    def __init__(self, ids: tuple[VehicleId, ...]) -> None:
        system_ids = {vehicle_id: number for number, vehicle_id in enumerate(ids, 1)}
        super().__init__("none", system_ids, (), ShowFrame(47.0, 8.0, 488.0))
