"""Fences in the autopilots: uploaded on the ground, verified, and watched in flight.

A vehicle gets the fence as soon as it is received, disarmed and in its place, and again after a restart. What
it has is read back, and read again every CHECK_S while it stands. One whose fence is changed by another
station is refused, and gets its fence again, UPLOADS_MAX times: then somebody has to look.
"""

import asyncio
import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import Final

import numpy as np

from gcs.failsafe.autopilot_failsafe import TEXTS_COUNT_S
from gcs.failsafe.autopilots.texts import Meaning, meaning_of
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.links.autopilots.versions import Version
from gcs.links.batch_link import Link
from gcs.links.fence_transfer import StoredFence
from gcs.mavlink.fences import fence_id, vertices_of
from gcs.model.errors import CommandError
from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.polygon_fence import PolygonFence
from gcs.model.preflight_report import Check, State
from gcs.model.state import Mask, StatusText, VehicleId
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import FencesView

log = logging.getLogger(__name__)

LOOK_S: Final = 0.25
RETRY_S: Final = 3.0
AGAIN_S: Final = 1.0
CHECK_S: Final = 30.0
"""So often a fence is read again on the ground; PX4 from 1.15 on reports its identity each second besides."""

SETTLE_S: Final = 1.0
"""PX4 loads a fence after it has acknowledged it, and says in a text which area it leaves out."""

UPLOADS_MAX: Final = 3
MARGIN_M: Final = 1.0
"""A vehicle that stands nearer to an edge may be outside as its autopilot sees it."""

FLIES: Final = AIRBORNE | {Phase.PILOT}
CHECK: Final = "uploaded fence"
UPLOADS: Final = "wait: it is uploaded to vehicles on the ground; look after its link if it stays so"
HOME: Final = "reboot the vehicle where it stands: its home is where it was switched on"
MOVE: Final = "move the vehicle into the site, or correct the site's file"
ANOTHER: Final = "end the other station that changes its fence, and reboot the vehicle: it is uploaded again"
FIRMWARE: Final = "fly a version that takes it, or draw the site with fewer corners"
REFUSED: Final = "correct what it says, and reboot the vehicle: the fence is uploaded again"
SHOWN_MAX: Final = 3


@dataclass(slots=True)
class _Upload:
    """What is known of one vehicle's fence."""

    verified: bool = False
    problem: str = "not known yet"
    to_do: str = UPLOADS
    uploads: int = 0  # since it was received, or was verified for long
    loaded: bool = False  # this station has uploaded it since the vehicle was received
    final: bool = False  # waiting does not mend it
    busy: bool = False
    not_before_s: float = -inf
    reported_id: int = -1  # as of its verification


class FenceUploads(Feature):
    """The fences of the vehicles of one station. Used on the event loop only."""

    name = "fences"

    def __init__(
        self,
        fence: PolygonFence | None,
        group: asyncio.TaskGroup,
        newest: Newest,
        vehicles: FlightVehicles,
        link_of: Mapping[VehicleId, Link],
        owned: Callable[[], Mask],
    ) -> None:
        """`fence`: None: none is uploaded. `owned` (n,): the vehicles that this station flies."""
        self.fence = fence
        self._vertices = () if fence is None else vertices_of(fence)
        self._own_id = fence_id(self._vertices)
        self._group, self._newest, self._vehicles = group, newest, vehicles
        self._link_of, self._owned = link_of, owned
        self._of = {name: _Upload() for name in vehicles} if fence is not None else {}
        self._rows = {name: row for link in set(link_of.values()) for row, name in enumerate(link.ids)}
        self._reboot_count: tuple[int, ...] = ()
        self._look_s = -inf
        self._texts: object = None  # as of the last look, and what of them is about fences
        self._about_fences: list[tuple[int, StatusText]] = []
        if fence is not None:
            for link in set(link_of.values()):
                link.watch_fences()

    # uploads

    def send(self) -> None:
        """Begin the transfers that are due."""
        now_s = self._newest.state.time_s
        if not self._of or now_s < self._look_s:
            return
        self._look_s = now_s + LOOK_S
        telemetry, owned = self._newest.telemetry, self._owned()
        self._forget_restarted()
        for vehicle in self._vehicles.values():
            upload = self._of[vehicle.id]
            self._watch_identity(vehicle, upload)
            stands = vehicle.phase is Phase.STANDBY and not telemetry.armed[vehicle.row]
            due = stands and owned[vehicle.row] and not upload.busy and now_s >= upload.not_before_s
            if due and not upload.final:
                self._begin(vehicle, upload)

    def _forget_restarted(self) -> None:
        """Begin anew with vehicles that have restarted, or were silent."""
        counts = self._newest.telemetry.reboot_count
        for vehicle in self._vehicles.values():
            restarted = self._reboot_count and counts[vehicle.row] != self._reboot_count[vehicle.row]
            if restarted or vehicle.phase is Phase.OFFLINE:
                self._link_of[vehicle.id].fences.home_deg[self._rows[vehicle.id]] = np.nan
                self._forget_identity(vehicle)
                self._of[vehicle.id] = _Upload()  # what is under way writes into the one before
        self._reboot_count = counts

    def _watch_identity(self, vehicle: Vehicle, upload: _Upload) -> None:
        """Doubt a fence whose reported identity has changed since it was verified, but for that of this one.

        What a vehicle sent while it was given the fence may still be about the one before.
        """
        reported_id = self._reported_id(vehicle)
        if not upload.verified or reported_id < 0 or reported_id == upload.reported_id:
            return
        if upload.reported_id < 0 or reported_id == self._own_id:
            upload.reported_id = reported_id
            return
        log.warning("fence_changed", extra={"vehicle": vehicle.id, "reason": "another identity"})
        upload.verified, upload.not_before_s = False, -inf
        upload.problem, upload.to_do = "its fence was changed by another station", UPLOADS

    def _forget_identity(self, vehicle: Vehicle) -> None:
        self._link_of[vehicle.id].fences.reported_id[self._rows[vehicle.id]] = -1

    def _reported_id(self, vehicle: Vehicle) -> int:
        fences = self._link_of[vehicle.id].fences
        return int(fences.reported_id[self._rows[vehicle.id]])

    def _begin(self, vehicle: Vehicle, upload: _Upload) -> None:
        problem, to_do = self._why_not(vehicle)
        if problem:
            upload.verified, upload.problem, upload.to_do = False, problem, to_do
            upload.not_before_s = self._newest.state.time_s + AGAIN_S
            return
        upload.busy = True
        self._group.create_task(self._bring(vehicle, upload), name=f"fence/{vehicle.id}")

    def _why_not(self, vehicle: Vehicle) -> tuple[str, str]:
        """Why this vehicle cannot have the fence, and what to do; empty: it can."""
        telemetry, row, habits = self._newest.telemetry, vehicle.row, vehicle.autopilot.fence
        version = Version.of(telemetry.version[row])
        at_deg = float(telemetry.latitude_deg[row]), float(telemetry.longitude_deg[row])
        if self.fence is None or not np.isfinite(at_deg).all():
            return "it has no position yet", "wait for its fix"
        if why := habits.why_not(self.fence, vehicle.autopilot.versions.possible(version)):
            return why, FIRMWARE
        if outside := self.fence.why_outside(at_deg, MARGIN_M):
            return f"it stands {outside}", MOVE
        return self._why_not_home(vehicle) if habits.loads_anew else ("", "")

    def _why_not_home(self, vehicle: Vehicle) -> tuple[str, str]:
        """Why the vehicle would leave out an area because of its home, though it acknowledges all of them."""
        fences, row = self._link_of[vehicle.id].fences, self._rows[vehicle.id]
        home_deg = float(fences.home_deg[row, 0]), float(fences.home_deg[row, 1])
        if self.fence is None or not np.isfinite(home_deg).all():
            fences.ask_home(row)
            return "its home is not known yet", UPLOADS
        outside = self.fence.why_outside(home_deg)
        return (f"its home is {outside}", HOME) if outside else ("", "")

    async def _bring(self, vehicle: Vehicle, upload: _Upload) -> None:
        """Have the vehicle get the fence, and keep what it says of that."""
        try:
            await self._upload(vehicle, upload)
        except CommandError as error:
            upload.verified, upload.problem, upload.to_do = False, str(error), UPLOADS
            upload.problem = upload.problem.removeprefix(f"{vehicle.id}: ")
            upload.not_before_s = self._newest.state.time_s + RETRY_S
        finally:
            upload.busy = False

    async def _upload(self, vehicle: Vehicle, upload: _Upload) -> None:
        """Compare, upload where it differs, and compare again. Raises: CommandError."""
        link, habits = self._link_of[vehicle.id], vehicle.autopilot.fence
        stored = await link.read_fence(vehicle.id, self._vertices)
        if stored.same and (upload.loaded or not habits.loads_anew):
            upload.uploads = 0
            self._verified(vehicle, upload)
            return
        if not stored.same:
            upload.verified, upload.problem, upload.to_do = False, self._differs(stored), UPLOADS
        if upload.uploads >= UPLOADS_MAX:
            upload.final, upload.to_do = True, ANOTHER
            upload.problem += f", though it was uploaded {upload.uploads} times"
            return
        if self._newest.telemetry.armed[vehicle.row]:
            return
        upload.uploads += 1
        self._forget_identity(vehicle)
        began_s = self._newest.state.time_s
        await link.upload_fence(vehicle.id, self._vertices, anew=habits.loads_anew)
        log.info("fence_uploaded", extra={"vehicle": vehicle.id, "corners": len(self._vertices)})
        stored = await link.read_fence(vehicle.id, self._vertices)
        if not stored.same:
            raise CommandError(self._differs(stored))
        if habits.refuses:
            await asyncio.sleep(SETTLE_S)
            if text := self._refusal(vehicle, habits.refuses, began_s):
                upload.final, upload.problem, upload.to_do = True, f'it says "{text}"', REFUSED
                return
        upload.loaded = True
        self._verified(vehicle, upload)

    def _differs(self, stored: StoredFence) -> str:
        if stored.items == 0:
            return "it has no fence"
        same = "" if stored.items != len(self._vertices) else "other "
        return f"it has another fence: {stored.items} {same}corners, {len(self._vertices)} are needed"

    def _refusal(self, vehicle: Vehicle, begins: str, since_s: float) -> str:
        texts = self._newest.telemetry.texts[vehicle.row]
        own = [each.text for each in texts if each.time_s >= since_s and each.text.startswith(begins)]
        return own[-1] if own else ""

    def _verified(self, vehicle: Vehicle, upload: _Upload) -> None:
        if not upload.verified:
            log.info("fence_verified", extra={"vehicle": vehicle.id})
        upload.verified, upload.problem, upload.to_do = True, "", ""
        upload.reported_id = self._reported_id(vehicle)
        upload.not_before_s = self._newest.state.time_s + CHECK_S

    # what is said of them

    def vehicle_checks(self, vehicle: Vehicle, at: Instant) -> Iterator[Check]:  # noqa: ARG002
        """Whether the vehicle has exactly this fence."""
        if self.fence is None:
            return
        upload, count = self._of[vehicle.id], len(self._vertices)
        limit = f"the site's, of {count} corners"
        if upload.verified:
            yield Check(CHECK, State.PASS, count, "corners", limit)
        else:
            yield Check(CHECK, State.FAIL, None, "corners", limit, upload.problem, upload.to_do)

    def conditions(self, at: Instant) -> Iterator[Condition]:
        """Yield breaches that autopilots report, and fences that are no longer the site's."""
        for vehicle, why in self._breaches(at.time_s):
            yield Condition(AlarmCause.OWN_FENCE, why, (vehicle.id,))
        for name, upload in self._of.items():
            if not upload.verified and self._vehicles[name].phase in FLIES:
                yield Condition(AlarmCause.FENCE_DIFFERS, upload.problem, (name,))

    def _breaches(self, now_s: float) -> Iterator[tuple[Vehicle, str]]:
        """Yield vehicles in flight that report a breach of their own fence, by their state or a text."""
        telemetry = self._newest.telemetry
        if telemetry.texts is not self._texts:
            self._texts = telemetry.texts
            newest = ((row, text) for row, own in enumerate(telemetry.texts) for text in own)
            self._about_fences = [each for each in newest if meaning_of(each[1].text) is Meaning.GEOFENCE]
        reported = {row: text for row, text in self._about_fences if now_s - text.time_s <= TEXTS_COUNT_S}
        for vehicle in self._vehicles.values():
            row = vehicle.row
            if vehicle.phase not in FLIES:
                continue
            if row in reported:
                yield vehicle, f'"{reported[row].text.rstrip(".")}"'
            elif vehicle.autopilot.beyond_fence(int(telemetry.unhealthy_sensors[row])):
                yield vehicle, "its autopilot reports the breach"

    def view(self, at: Instant) -> FencesView | None:
        if self.fence is None:
            return None
        owned = self._owned()
        own = {name: each for name, each in self._of.items() if owned[self._vehicles[name].row]}
        without = [f"{name}: {each.problem}" for name, each in own.items() if not each.verified]
        more = f"; and {len(without) - SHOWN_MAX} more" if len(without) > SHOWN_MAX else ""
        return FencesView(
            polygons=len(self.fence.polygons),
            corners=len(self._vertices),
            verified=float(len(own) - len(without)),
            missing="; ".join(without[:SHOWN_MAX]) + more,
            breached=", ".join(vehicle.id for vehicle, _ in self._breaches(at.time_s)),
        )
