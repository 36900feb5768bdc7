"""Written shows of a site: any station selects one, the lead plays it, every station has it.

The lead alone decides the plan. The other stations have the show for its limits, its fence, its hash and its
lights, and its clock from the lead: one of them that takes the lead goes on with it.
"""

import json
import logging
import zlib
from base64 import b64decode, b64encode
from binascii import Error as Base64Error
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final

from pydantic import TypeAdapter

from gcs.flight.running_show import ShowRun
from gcs.flight.show_player import ShowPlayer
from gcs.flight.site_member import SiteMember
from gcs.flight.site_requests import PART_MAX, PARTS_MAX, REQUEST, Refusal, ShowChange, ShowMissing, ShowPart
from gcs.model.errors import GcsError, LinkError, RefusedError
from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.state import VehicleId
from gcs.service import CALLER, SelectedShow, ShowFigures
from gcs.shows import Flaw, Show, Timeline

log = logging.getLogger(__name__)

AGAIN_S: Final = 1.0
"""Interval between two requests for a show that has not arrived."""

UNPACKED_MAX_BYTES: Final = 2_000_000
"""Of a show as JSON; its file has at most 64 KiB."""

_FIGURES: Final[TypeAdapter[ShowFigures | None]] = TypeAdapter(ShowFigures | None)


def packed(show_run: ShowRun) -> list[str]:
    """A show as text, in parts that fit into a request."""
    about = {
        "name": show_run.name,
        "show": show_run.timeline.show.model_dump(mode="json"),
        "figures": _FIGURES.dump_python(show_run.figures, mode="json"),
    }
    text = b64encode(zlib.compress(json.dumps(about, separators=(",", ":")).encode())).decode()
    return [text[at : at + PART_MAX] for at in range(0, len(text), PART_MAX)]


def unpacked(parts: Sequence[str], show_hash: str) -> ShowRun:
    """The show of these parts. Raises: RefusedError when they are not the show of this hash."""
    try:
        reader = zlib.decompressobj()
        text = reader.decompress(b64decode("".join(parts), validate=True), UNPACKED_MAX_BYTES)
        read = json.loads(text)
        show = Show.model_validate_json(json.dumps(read["show"]))
        figures = _FIGURES.validate_python(read["figures"])
        if show.digest != show_hash:
            raise RefusedError(f"the show that arrived has the hash {show.digest}, not {show_hash[:64]}")
        return ShowRun(str(read["name"])[:60], Timeline.of(show), figures=figures, received=True)
    except (Base64Error, zlib.error, ValueError, LookupError, TypeError) as error:
        raise RefusedError(f"the show that arrived cannot be read: {error!r}"[:300]) from None


@dataclass(eq=False)
class SiteShowPlayer(ShowPlayer):
    """Plays the show at the lead, and keeps with the lead elsewhere. Implements `gcs.service.Player`."""

    member: SiteMember

    def __post_init__(self) -> None:
        super().__post_init__()
        self._arriving: tuple[str, dict[int, str]] = ("", {})  # parts of a show, by its hash
        self._arrived: ShowRun | None = None  # the newest complete one
        self._packed: tuple[str, list[str]] = ("", [])  # the newest that was sent, by its hash
        self._ask_due_s = 0.0
        self._followed = False  # at the last tick

    @property
    def leads(self) -> bool:
        return self.member.site.lead.leads

    # commands

    def select(self, name: str, show_hash: str) -> SelectedShow:
        if self.leads:
            return super().select(name, show_hash)
        self._need_lead("select a show")
        timeline = self._fitting(name, self.show_library.cleared(name, show_hash))
        show_run = ShowRun(name, timeline, figures=self.show_library.checked(name).figures)
        self._post_show(self.member.site.lead.name, show_run)
        self._ask("select", show_hash)
        return show_run.view(self.flight.fleet.time_s)

    def deselect(self) -> None:
        if self.leads:
            super().deselect()
            return
        self._need_lead("deselect the show")
        self._ask("deselect", "")

    def seek(self, cue: str) -> SelectedShow:
        if self.leads:
            return super().seek(cue)
        show_run, now_s = self.flight.show_run, self.flight.fleet.time_s
        if show_run is None:
            raise RefusedError("no show is selected: seek is for one that is")
        self._need_lead("seek a cue")
        clock = show_run.clock.seek(show_run.timeline, cue, grounded=True)
        self._ask("seek", cue)
        return replace(show_run, clock=clock).view(now_s)

    def begin_at(self, at_unix_time_s: float) -> SelectedShow:  # noqa: ARG002 (as the port names it)
        raise RefusedError("several stations fly: a show begins at a clock time with one station alone")

    def _need_lead(self, what: str) -> None:
        self.flight.need_no_countdown()
        self.need_ground(what)
        if not self.member.lead_is_here:
            name = self.member.site.lead.name
            raise RefusedError(f"the leading station {name} is not received: gcs lead take")

    def need_ground(self, what: str) -> None:
        super().need_ground(what)
        if self.member.shows_of_others_fly:
            raise RefusedError(f"cannot {what} while vehicles of other stations fly")

    def _ask(self, action: Any, value: str) -> None:
        request = ShowChange(CALLER.get(), action, value)
        self.member.post(self.member.site.lead.name, REQUEST.dump_python(request, mode="json"))

    def change_for(self, station: str, request: ShowChange) -> None:
        """Execute what another station asks of the lead; a refusal is logged here and there."""
        try:
            if not self.leads:
                raise RefusedError(f"station {self.member.site.own} does not lead")
            if request.action == "select":
                self._select_arrived(request.value)
            elif request.action == "deselect":
                super().deselect()
            else:
                super().seek(request.value)
        except GcsError as refused:
            self.member.refuse(station, Refusal(f"to {request.action}", request.by, str(refused)[:500]))

    def _select_arrived(self, show_hash: str) -> None:
        self.flight.need_no_countdown()
        self.need_ground("select a show")
        show_run = self._arrived
        if show_run is None or show_run.hash != show_hash:
            raise RefusedError("the show has not arrived")
        self._fitting(show_run.name, show_run.timeline)
        self._take(replace(show_run))

    def _own_misfits(self, show: Show) -> list[Flaw]:
        found = super()._own_misfits(show)
        if show.drawing is not None:
            text = "drawing: stations do not hand drawings to each other: fly it with one station alone"
            found.insert(0, Flaw(("drawing",), text))
        return found

    # between stations

    def take_part(self, part: ShowPart) -> None:
        """Note a part of a show; an unreadable show is logged."""
        if self._arriving[0] != part.hash:
            self._arriving = part.hash, {}
        parts = self._arriving[1]
        parts[part.part] = part.text
        if len(parts) < min(part.parts, PARTS_MAX):
            return
        self._arriving = "", {}
        try:
            self._arrived = unpacked([parts[at] for at in sorted(parts)], part.hash)
        except GcsError as refused:
            log.warning("show_unreadable", extra={"reason": str(refused)})

    def send_to(self, station: str, request: ShowMissing) -> None:
        """Send the selected show to a station that has not got it; it asks again if it does not arrive."""
        show_run = self.flight.show_run
        if show_run is None or show_run.hash != request.hash:
            return
        try:
            self._post_show(station, show_run)
        except (RefusedError, LinkError) as error:
            log.warning("show_not_sent", extra={"other": station, "reason": str(error)})

    def _post_show(self, station: str, show_run: ShowRun) -> None:
        if self._packed[0] != show_run.hash:
            self._packed = show_run.hash, packed(show_run)
        texts = self._packed[1]
        if len(texts) > PARTS_MAX:
            raise RefusedError(f"show {show_run.name!r} is too large for the bus: {len(texts)} parts")
        for number, text in enumerate(texts):
            part = ShowPart(show_run.hash, number, len(texts), text)
            self.member.post(station, REQUEST.dump_python(part, mode="json"))

    # once a tick

    def lead(self) -> None:
        flight, show_run = self.flight, self.flight.show_run
        if not self.leads:
            self._followed = True
            self._keep_with_lead()
            return
        now_s = flight.fleet.time_s
        if self._followed and show_run is not None and show_run.is_live(now_s) and show_run.live is None:
            show_run.live = flight.plan.target
        self._followed = False
        super().lead()

    def _keep_with_lead(self) -> None:
        if not self.member.lead_is_here:
            self.member.lead_show = None  # a lead that comes back may not fly the show yet
        flight, led, now_s = self.flight, self.member.lead_show, self.flight.fleet.time_s
        if led is None:
            return
        show_run = flight.show_run
        if not led.hash:
            if show_run is not None:
                flight.show_run, flight.control = None, flight.config.control
        elif show_run is not None and show_run.hash == led.hash:
            show_run.clock, show_run.started = led.clock, led.started
        elif self._arrived is not None and self._arrived.hash == led.hash:
            if show_run is None:
                self._reported = flight.plan
            self._control(replace(self._arrived, clock=led.clock, started=led.started))
        elif now_s >= self._ask_due_s:
            self._ask_due_s = now_s + AGAIN_S
            missing = REQUEST.dump_python(ShowMissing(led.hash), mode="json")
            with suppress(LinkError):  # as many wait as may: the lead is hardly received
                self.member.post(self.member.site.lead.name, missing)

    @property
    def why_not_here(self) -> str:
        """Why this station cannot start the lead's show; empty when it can, or there is none."""
        led, show_run = self.member.lead_show, self.flight.show_run
        here = "" if show_run is None else show_run.hash
        if self.leads or led is None or led.hash == here:
            return ""
        return "the selected show has not arrived from the lead"

    # vehicles of all stations

    @property
    def _count(self) -> int:
        return len(self.member.site.shown)

    def _others_start(self, *, named: bool) -> int:
        if named:
            return 0
        return sum(len(self.member.ids_of(name, Phase.STANDBY)) for name in self.member.present())

    def give_parts(self, chosen: Sequence[VehicleId]) -> Sequence[VehicleId]:
        flies = super().give_parts(chosen)
        show_run, member = self.flight.show_run, self.member
        if show_run is None:
            return flies
        flying = set(chosen)
        for name in member.present():
            flying.update(member.ids_of(name, Phase.STANDBY, *AIRBORNE))
        ordered = [one for one in member.all_ids if one in flying]
        most = show_run.timeline.show.fleet.vehicles
        show_run.parts = {name: part for part, name in enumerate(ordered[:most])}
        return flies

    def pads(self) -> dict[VehicleId, int]:
        rows = {name: row for row, name in enumerate(self.member.all_ids)}
        numbered = {name: rows[name] for name in self.flight.vehicles}
        show_run = self.flight.show_run
        most = 0 if show_run is None else len(show_run.timeline.show.pads_m)
        return {name: row for name, row in numbered.items() if row < most}

    @property
    def target_age_s(self) -> float:
        return super().target_age_s if self.leads else float("nan")
