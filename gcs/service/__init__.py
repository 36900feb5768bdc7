"""The port between flight and outside: commands in, snapshots out; imports safety, estimation and model.

The API, the console and the command line know the service by this package only, so that control can move to
a process of its own without a change on their side.
"""

from gcs.estimation.time_estimates import Estimates
from gcs.service.commands import CALLER, CommandRecord, Outcome, ShowAction, VehicleAction, VehicleOutcome
from gcs.service.interface import Audit, Call, NoAudit, PlaybackChange, Replaying, Service, Shows
from gcs.service.snapshots import (
    ActiveFailsafe,
    CheckState,
    CueMark,
    EventMark,
    FleetView,
    FlightEnvelope,
    IdleSpan,
    Latest,
    PhaseSpan,
    Playback,
    ReplayMarks,
    ReportState,
    SelectedShow,
    ShowCheck,
    StoredShow,
    TickView,
)

__all__ = [
    "CALLER",
    "ActiveFailsafe",
    "Audit",
    "Call",
    "CheckState",
    "CommandRecord",
    "CueMark",
    "Estimates",
    "EventMark",
    "FleetView",
    "FlightEnvelope",
    "IdleSpan",
    "Latest",
    "NoAudit",
    "Outcome",
    "PhaseSpan",
    "Playback",
    "PlaybackChange",
    "ReplayMarks",
    "Replaying",
    "ReportState",
    "SelectedShow",
    "Service",
    "ShowAction",
    "ShowCheck",
    "Shows",
    "StoredShow",
    "TickView",
    "VehicleAction",
    "VehicleOutcome",
]
