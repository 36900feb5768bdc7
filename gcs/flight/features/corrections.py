"""Corrections for RTK: what arrived from the base, and how old it is."""

from collections.abc import Iterator, Sequence

import numpy as np

from gcs.flight.state.feature import Feature, Instant
from gcs.links.batch_link import Link
from gcs.links.corrections import LONGEST_BYTES, CorrectionSender
from gcs.links.features import RtkSettings
from gcs.links.intake import Intake
from gcs.links.rtk import CORRECTIONS, keep_receiving
from gcs.model.preflight_report import Check, State
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import CorrectionsView


class Corrections(Feature):
    """Corrections of one station; without settings none are expected. Used on the event loop only."""

    name = "corrections"

    def __init__(self, settings: RtkSettings | None, links: Sequence[Link], now_s: float) -> None:
        self.settings = settings
        self.intakes = (Intake(f"rtk {settings.source}" if settings else "rtk", CORRECTIONS),)
        self._senders = [(link, CorrectionSender(link.outbox, link.budget)) for link in links]
        self._began_s = now_s
        self._arrived_s = -np.inf
        self._messages = self._bytes = self._too_long = 0
        self._base: tuple[float, float, float] | None = None
        self._problem = ""

    async def receive(self) -> None:
        if self.settings is not None:
            await keep_receiving(self.settings, self.take, self.failed, *self.intakes)

    def take(self, message: bytes, base: tuple[float, float, float] | None, now_s: float) -> None:
        """Queue one RTCM message for all vehicles; `base` is where the base is, None: not known yet."""
        self._arrived_s, self._problem = now_s, ""
        self._base = base or self._base
        self._messages += 1
        self._bytes += len(message)
        if len(message) > LONGEST_BYTES:
            self._too_long += 1
            return
        for _, sender in self._senders:
            sender.add(message, now_s)

    def failed(self, why: str) -> None:
        """Note why nothing arrives."""
        self._problem = why

    def send(self) -> None:
        for link, sender in self._senders:
            if sender.waits and (reached := link.reached()) is not None:
                sender.send(reached[0])

    def why_stopped(self, now_s: float) -> str:
        """Why there are no recent corrections, in words; empty while there are, or none are expected."""
        if self.settings is None:
            return ""
        silent_s = now_s - max(self._arrived_s, self._began_s)
        if silent_s <= self.settings.age_max_s:
            return ""
        since = f"for {silent_s:.0f} s" if np.isfinite(self._arrived_s) else "since the service began"
        return f"none {since}{f' ({self._problem})' if self._problem else ''}"

    def checks(self, at: Instant) -> list[Check]:
        """The check before a start, where corrections are required."""
        if self.settings is None or not self.settings.required:
            return []
        age_s = at.time_s - self._arrived_s
        limit = f"at most {self.settings.age_max_s:g} s old"
        if age_s <= self.settings.age_max_s:
            return [Check("corrections", State.PASS, age_s, "s", limit)]
        why = self.why_stopped(at.time_s) or "none since the service began"
        problem, to_do = f"no corrections for RTK: {why}", "check the base, its antenna and the network"
        measured_s = age_s if np.isfinite(age_s) else None
        return [Check("corrections", State.FAIL, measured_s, "s", limit, problem, to_do)]

    def conditions(self, at: Instant) -> Iterator[Condition]:
        if why := self.why_stopped(at.time_s):
            consequence = "Margins grow with the accuracy that the vehicles report."
            yield Condition(AlarmCause.CORRECTIONS_STOPPED, why, consequence=consequence)

    def view(self, at: Instant) -> CorrectionsView | None:
        now_s = at.time_s
        if self.settings is None:
            return None
        latitude_deg, longitude_deg, height_m = self._base or (np.nan,) * 3
        late = sum(sender.dropped for _, sender in self._senders)
        return CorrectionsView(
            source=self.settings.source,
            age_s=max(0.0, now_s - self._arrived_s) if np.isfinite(self._arrived_s) else np.nan,
            problem=self.why_stopped(now_s),
            base_latitude_deg=latitude_deg,
            base_longitude_deg=longitude_deg,
            base_height_m=height_m,
            messages=self._messages,
            received_bytes=self._bytes,
            sent=sum(sender.sent for _, sender in self._senders),
            dropped=self._too_long + self.intakes[0].dropped + late,
        )
