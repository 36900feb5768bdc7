"""What stations ask of each other, and answer: commands, changes of the plan, outcomes."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, TypeAdapter

from gcs.model.interrupted_flight import Offer
from gcs.model.state import VehicleId
from gcs.service import Outcome, ShowAction, VehicleAction
from gcs.site.agreement import NAMES_MAX
from gcs.stations.messages import COUNT_MAX

Named: TypeAlias = Annotated[tuple[VehicleId, ...], Field(max_length=COUNT_MAX)]
Text: TypeAlias = Annotated[str, Field(max_length=500)]

PART_MAX: Final = 40_000
"""Characters of a part of a show."""

PARTS_MAX: Final = 16


@dataclass(frozen=True, slots=True)
class ShowRequest:
    """Execute a fleet-wide command."""

    ref: Text  # of the command at the station that asks
    by: Text
    action: ShowAction
    vehicles: Named | None = None  # START only: None: all but those left out
    at_unix_time_s: float | None = None
    show_hash: Text | None = None  # START only: of the selected show
    reason: Text = ""  # of a failsafe; empty: an operator's command
    named: Named | None = None  # START of a show: the vehicles of all stations; None: all but those left out
    proposed_by: Text = ""  # START that needs two tokens: their names, checked by the lead
    confirmed_by: Text = ""
    rules: Annotated[dict[Text, Text], Field(max_length=NAMES_MAX)] | None = None  # START: of the asker
    parameters: Text = ""  # START that needs two tokens: hash of those of the receiver, as confirmed
    kind: Literal["show"] = "show"


@dataclass(frozen=True, slots=True)
class VehiclesRequest:
    """Execute a command for some of the receiver's vehicles; None: all that it can apply to."""

    ref: Text
    by: Text
    action: VehicleAction
    vehicles: Named | None
    kind: Literal["vehicles"] = "vehicles"


@dataclass(frozen=True, slots=True)
class KillRequest:
    """Stop motors."""

    ref: Text
    by: Text
    vehicles: Named
    kind: Literal["kill"] = "kill"


@dataclass(frozen=True, slots=True)
class SettleRequest:
    """Settle an interrupted flight of the receiver."""

    ref: Text
    by: Text
    offer: Offer
    kind: Literal["settle"] = "settle"


@dataclass(frozen=True, slots=True)
class ExcludeRequest:
    """Take one of the receiver's vehicles out of the show, or include it again."""

    ref: Text
    by: Text
    vehicle: VehicleId
    reason: Text | None  # None: include it
    kind: Literal["exclude"] = "exclude"


@dataclass(frozen=True, slots=True)
class StandbyRequest:
    """Fly on with the vehicles of a lost station that the receiver stands by for."""

    ref: Text
    by: Text
    station: Text
    kind: Literal["standby"] = "standby"


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """Change the plan; only the lead does."""

    number: int
    by: Text
    change: Literal[
        "set_formation",
        "set_orbit",
        "set_target",
        "set_yaw",
        "add_obstacle",
        "change_obstacle",
        "remove_obstacle",
        "select_target",
        "hold_target",
    ]
    value: dict[str, Any]  # of the fields that are changed
    kind: Literal["plan"] = "plan"


@dataclass(frozen=True, slots=True)
class ShowPart:
    """A part of a show, see `gcs.site.arrivals`."""

    hash: Text
    part: Annotated[int, Field(ge=0, lt=PARTS_MAX)]
    parts: Annotated[int, Field(ge=1, le=PARTS_MAX)]
    text: Annotated[str, Field(max_length=PART_MAX)]
    kind: Literal["show-part"] = "show-part"


@dataclass(frozen=True, slots=True)
class ShowMissing:
    """Send the show of this hash, which the lead has selected."""

    hash: Text
    kind: Literal["show-missing"] = "show-missing"


@dataclass(frozen=True, slots=True)
class ShowChange:
    """Change the show at the lead."""

    by: Text
    action: Literal["select", "deselect", "seek", "begin", "cancel-begin", "follow-external-clock"]
    value: Text = ""  # the hash of a show that was sent before, a cue, a Unix time, yes or no
    kind: Literal["show-change"] = "show-change"


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why the lead has not made a change; an answer to a request without a command record."""

    change: Text
    by: Text
    reason: Text
    kind: Literal["refusal"] = "refusal"


@dataclass(frozen=True, slots=True)
class Outcomes:
    """How a requested command goes on; complete."""

    ref: Text
    outcomes: dict[VehicleId, tuple[Outcome, Text]] = field(default_factory=dict)
    refused: Text = ""  # why the station does not execute it
    kind: Literal["outcomes"] = "outcomes"


CommandRequest: TypeAlias = (
    ShowRequest | VehiclesRequest | KillRequest | SettleRequest | ExcludeRequest | StandbyRequest
)
"""Requests with a command record at the station that asks."""

Request: TypeAlias = CommandRequest | PlanRequest | ShowPart | ShowMissing | ShowChange | Refusal | Outcomes

REQUEST: Final[TypeAdapter[Request]] = TypeAdapter(Annotated[Request, Field(discriminator="kind")])
"""Reads and writes them as JSON. Raises: ValueError for anything else."""
