"""The port between flight and outside: commands in, snapshots out; imports safety, estimation and model.

The API, the console and the command line know the service by this package only, so that control can move to
a process of its own without a change on their side.
"""

from gcs.estimation.time_estimates import Estimates
from gcs.model.interrupted_flight import InterruptedFlight
from gcs.model.plan import Obstacle, Orbit
from gcs.model.preflight_report import PreflightReport
from gcs.service.alarms import Alarm
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
    ShowFigures,
    StoredShow,
    TickView,
)

__all__ = [
    "CALLER",
    "ActiveFailsafe",
    "Alarm",
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
    "InterruptedFlight",
    "Latest",
    "NoAudit",
    "Obstacle",
    "Orbit",
    "Outcome",
    "PhaseSpan",
    "Playback",
    "PlaybackChange",
    "PreflightReport",
    "ReplayMarks",
    "Replaying",
    "ReportState",
    "SelectedShow",
    "Service",
    "ShowAction",
    "ShowCheck",
    "ShowFigures",
    "Shows",
    "StoredShow",
    "TickView",
    "VehicleAction",
    "VehicleOutcome",
]
