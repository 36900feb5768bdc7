"""The port between flight and outside: commands in, snapshots out; imports safety, estimation and model.

The API, the console and the command line know the service by this package only, so that control can move to
a process of its own without a change on their side.
"""

from gcs.estimation.time_estimates import Estimates as Estimates
from gcs.model.interrupted_flight import InterruptedFlight as InterruptedFlight
from gcs.model.plan import Obstacle as Obstacle
from gcs.model.plan import Orbit as Orbit
from gcs.model.preflight_report import PreflightReport as PreflightReport
from gcs.service.alarms import Alarm as Alarm
from gcs.service.commands import CALLER as CALLER
from gcs.service.commands import CommandRecord as CommandRecord
from gcs.service.commands import Outcome as Outcome
from gcs.service.commands import ShowAction as ShowAction
from gcs.service.commands import VehicleAction as VehicleAction
from gcs.service.commands import VehicleOutcome as VehicleOutcome
from gcs.service.features import Features as Features
from gcs.service.features import TargetsView as TargetsView
from gcs.service.features import TrafficView as TrafficView
from gcs.service.go import GoView as GoView
from gcs.service.go import WeatherEntry as WeatherEntry
from gcs.service.interface import DRAWING_MAX_BYTES as DRAWING_MAX_BYTES
from gcs.service.interface import Audit as Audit
from gcs.service.interface import Call as Call
from gcs.service.interface import NoAudit as NoAudit
from gcs.service.interface import PlaybackChange as PlaybackChange
from gcs.service.interface import Replaying as Replaying
from gcs.service.interface import Service as Service
from gcs.service.interface import Shows as Shows
from gcs.service.interface import SiteFile as SiteFile
from gcs.service.interface import Stations as Stations
from gcs.service.site_view import SiteFormat as SiteFormat
from gcs.service.site_view import SiteView as SiteView
from gcs.service.snapshots import ActiveFailsafe as ActiveFailsafe
from gcs.service.snapshots import BeginState as BeginState
from gcs.service.snapshots import BeginView as BeginView
from gcs.service.snapshots import BusView as BusView
from gcs.service.snapshots import CheckState as CheckState
from gcs.service.snapshots import CommandMark as CommandMark
from gcs.service.snapshots import CueMark as CueMark
from gcs.service.snapshots import EventMark as EventMark
from gcs.service.snapshots import FleetView as FleetView
from gcs.service.snapshots import FlightEnvelope as FlightEnvelope
from gcs.service.snapshots import FlightMarks as FlightMarks
from gcs.service.snapshots import IdleSpan as IdleSpan
from gcs.service.snapshots import Latest as Latest
from gcs.service.snapshots import PhaseSpan as PhaseSpan
from gcs.service.snapshots import Playback as Playback
from gcs.service.snapshots import ReportState as ReportState
from gcs.service.snapshots import Scheduling as Scheduling
from gcs.service.snapshots import SelectedShow as SelectedShow
from gcs.service.snapshots import ShowCheck as ShowCheck
from gcs.service.snapshots import ShowFigures as ShowFigures
from gcs.service.snapshots import StationView as StationView
from gcs.service.snapshots import StoredShow as StoredShow
from gcs.service.snapshots import TickView as TickView
