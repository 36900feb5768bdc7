"""Conditions that an operator must know, most severe first; pure (decision 0023).

Sources report regularly which `Condition`s hold; the `AlarmBook` turns them into `Alarm`s. To add a cause:

1. add a member to `AlarmCause` and its row to `CAUSES` (severity, headline, advice);
2. add its row to the table in docs/operations/in-flight.md (a test compares the two);
3. yield a `Condition` while the cause holds, from `gcs.flight.monitors.alarm_monitor` or from one of its
   sources. Pass a value at a limit through `beyond` first, so that it does not flicker.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from gcs.model.settings import PUBLISHED
from gcs.model.state import Array, Mask, VehicleId


class AlarmSeverity(StrEnum):
    """How soon an operator must act, most severe first."""

    EMERGENCY = "emergency"  # people or vehicles may come to harm now: act at once
    WARNING = "warning"  # a vehicle or the service is not fit for flight: act soon
    CAUTION = "caution"  # a safeguard is missing or a limit is near: be ready to act
    INFORMATION = "information"  # no action needed


class AlarmCause(StrEnum):
    """Cause of an alarm."""

    KILLED = "killed"
    TERMINATED = "terminated"
    CONTROL_STOPPED = "control-stopped"
    TOO_CLOSE = "too-close"
    VEHICLES_LOST = "vehicles-lost"
    CRITICAL_BATTERY = "critical-battery"
    OUTSIDE_FENCE = "outside-fence"
    GROUND_LEFT = "ground-left"
    OWN_FENCE = "own-fence"
    VEHICLE_LOST = "vehicle-lost"
    LOW_BATTERY = "low-battery"
    BAD_POSITION = "bad-position"
    GROUND_NEAR = "ground-near"
    LAND_NOW = "land-now"
    LANDS_IN_PLACE = "lands-in-place"
    NOT_LOWER = "not-lower"
    WIND = "wind"
    WIND_MEASURED = "wind-measured"
    LINKS_LATE = "links-late"
    SERVICE_LATE = "service-late"
    OWN_FAILSAFE = "own-failsafe"
    OUTSIDE_CONTROL = "outside-control"
    PARAMETER_CHANGED = "parameter-changed"
    FENCE_DIFFERS = "fence-differs"
    INTERRUPTED = "interrupted"
    DUPLICATE_SYSTEM_ID = "duplicate-system-id"
    LINK_FAILED = "link-failed"
    STATION_LOST = "station-lost"
    RETURN_UNPLANNED = "return-unplanned"
    TARGET_STALE = "target-stale"
    TARGET_LOST = "target-lost"
    TARGET_OUTRUNS = "target-outruns"
    TARGET_BEYOND = "target-beyond"
    TARGET_SOURCES = "target-sources"
    TARGET_NEAR = "target-near"
    TARGET_NO_ROOM = "target-no-room"
    TRAFFIC_MANNED = "traffic-manned"
    TRAFFIC_NEAR = "traffic-near"
    TRAFFIC_CROWDED = "traffic-crowded"
    TRAFFIC_UNKNOWN = "traffic-unknown"
    TAK_NOT_SENT = "tak-not-sent"
    REMOTE_ID = "remote-id"
    OPERATOR_UNKNOWN = "operator-unknown"
    OBSTACLE_NEAR = "obstacle-near"
    OBSTACLE_WAITS = "obstacle-waits"
    LAW_FAILED = "law-failed"
    NO_HEADWAY = "no-headway"
    NO_WAY = "no-way"
    RADIUS_SMALL = "radius-small"
    UNCERTAIN_POSITION = "uncertain-position"
    LITTLE_AUTHORITY = "little-authority"
    SLOW_VEHICLE = "slow-vehicle"
    SLOW_ANSWERS = "slow-answers"
    HEIGHT_DIFFERS = "height-differs"
    MOVED_ON_PAD = "moved-on-pad"
    CORRECTIONS_STOPPED = "corrections-stopped"
    TIMECODE = "timecode"
    CLOCK_DOUBTFUL = "clock-doubtful"
    WEATHER_DIFFERS = "weather-differs"
    START_NOT_READY = "start-not-ready"
    SILENT = "silent"
    POOR_LINK = "poor-link"
    NO_HEARTBEAT = "no-heartbeat"
    INPUT_FLOODED = "input-flooded"
    RECORD_FAILS = "record-fails"
    SUPERVISOR_GONE = "supervisor-gone"
    NOT_FLYING = "not-flying"
    STACKED = "stacked"
    SERVICE_NOTE = "service-note"
    REPLAY = "replay"


class AlarmAction(StrEnum):
    """A command of the service that does what an alarm advises."""

    RETURN = "return"
    LAND = "land"
    TAKE_CONTROL = "take-control"
    CONFIRM_DOWN = "confirm-down"
    LEAVE_OUT = "leave-out"
    INCLUDE = "include"
    PAUSE = "pause"  # the show, as the next one
    STOP = "stop"  # all return home


@dataclass(frozen=True, slots=True)
class CauseRow:
    """Properties shared by all alarms of one cause."""

    severity: AlarmSeverity
    headline: (
        str  # start of the text, as `for_number` takes it; {vehicles} is "Vehicle d3", {about} the object
    )
    advice: str  # as `for_number` takes it
    on_after_s: float = 0.0  # the condition must hold for this time
    off_after_s: float = 1.0  # and be absent for this time: if it returns sooner, it is the same alarm
    action: AlarmAction | None = None  # does what the advice says
    past: str = ""  # the headline once it has ended; empty: with [was|were] behind the vehicles


E, W, C, I = AlarmSeverity  # noqa: E741 (the letters are the table's)
X: Final = AlarmAction

CAUSES: Final[dict[AlarmCause, CauseRow]] = {
    AlarmCause.KILLED: CauseRow(
        E,
        "{vehicles} killed",
        "Keep people away from where [it|they] may lie. When [it was|they were] seen on the ground:"
        " confirm-down.",
        off_after_s=0.0,
        action=X.CONFIRM_DOWN,
    ),
    AlarmCause.TERMINATED: CauseRow(
        E,
        "{vehicles} falling",
        "Keep people away from where [it comes down|they come down]. When [it was|they were] seen on the"
        " ground: confirm-down.",
        off_after_s=0.0,
        action=X.CONFIRM_DOWN,
    ),
    AlarmCause.CONTROL_STOPPED: CauseRow(
        E,
        "Control stopped",
        "Each vehicle holds, comes home or lands by its own failsafe within seconds, and a pilot can take it"
        " over. Keep people away from below, and restart the service: it offers take-over or bring-home."
        " gcs kill --direct lets vehicles fall: only where one endangers people and no pilot has it.",
        off_after_s=0.0,
        past="Control had stopped",
    ),
    AlarmCause.TOO_CLOSE: CauseRow(
        E, "{vehicles} too close", "Pause the show. If they do not part, hold or land one of them.",
        action=X.PAUSE,
    ),
    AlarmCause.VEHICLES_LOST: CauseRow(
        E,
        "Too many vehicles lost",
        "Watch where they come down and keep people away; check radio and power.",
        past="Too many vehicles were lost",
    ),
    AlarmCause.CRITICAL_BATTERY: CauseRow(
        E,
        "{vehicles} critically low on battery",
        "Let [it land where it is|them land where they are]; keep people away from below.",
        action=X.LAND,
    ),
    AlarmCause.OUTSIDE_FENCE: CauseRow(
        E, "{vehicles} about to leave the fence", "Land [it if it does|those that do] not turn back.",
        action=X.LAND,
    ),
    AlarmCause.GROUND_LEFT: CauseRow(
        E,
        "{vehicles} could fall outside the controlled ground",
        "Land [it if it does|those that do] not turn back. [If it flies|Those that fly] on outward: kill [it|"
        "them] now, farther out [it falls|they fall] among people.",
        action=X.LAND,
        past="{vehicles} could have fallen outside the controlled ground",
    ),
    AlarmCause.OWN_FENCE: CauseRow(
        E,
        "{vehicles} beyond [its own fence|their own fences]",
        "Let [its autopilot act|their autopilots act]; land [it if it does|those that do] not turn back.",
        action=X.LAND,
    ),
    AlarmCause.VEHICLE_LOST: CauseRow(
        W,
        "{vehicles} lost",
        "Watch where [it flies: it follows its own failsafe|they fly, by their own failsafe]. When [it"
        " was|they were] seen on the ground: confirm-down.",
        off_after_s=0.0,
        action=X.CONFIRM_DOWN,
    ),
    AlarmCause.LOW_BATTERY: CauseRow(
        W, "{vehicles} low on battery", "Let [it|them] return home.",
        action=X.RETURN,
    ),
    AlarmCause.BAD_POSITION: CauseRow(
        W,
        "{vehicles} without a trusted position",
        "Watch [it; land it where it is if it drifts|them; land those that drift where they are].",
        action=X.LAND,
    ),
    AlarmCause.GROUND_NEAR: CauseRow(
        W,
        "{vehicles} near the edge of where [it|they] may fall",
        "Pause the show; land [it if it does|those that do] not turn back.",
        action=X.PAUSE,
    ),
    AlarmCause.LAND_NOW: CauseRow(
        W,
        "{vehicles} asked to land by the autopilot",
        "Land [it|them].",
        action=X.LAND,
    ),
    AlarmCause.LANDS_IN_PLACE: CauseRow(
        W,
        "{vehicles} [lands where it is|land where they are]",
        "Keep people away from where [it comes|they come] down.",
        off_after_s=0.0,
        past="{vehicles} landed where [it was|they were]",
    ),
    AlarmCause.NOT_LOWER: CauseRow(
        W,
        "{vehicles} [is to come down and gets|are to come down and get] no lower",
        "Look for what keeps [it|them] up, and watch [its battery|their batteries]. Hold [it|them], then land"
        " [it|them] again; or have a pilot land [it|them] by hand.",
        action=X.LAND,
        past="{vehicles} had got no lower while coming down",
    ),
    AlarmCause.WIND: CauseRow(
        W, "Too much wind", "Bring the show home if the wind does not drop.",
        action=X.STOP, past="There was too much wind",
    ),
    AlarmCause.WIND_MEASURED: CauseRow(
        W,
        "More wind than allowed",
        "Bring the show home: a vehicle that fails may fall farther than the site allows.",
        on_after_s=1.0,
        off_after_s=5.0,
        action=X.STOP,
        past="There was more wind than allowed",
    ),
    AlarmCause.SERVICE_LATE: CauseRow(
        W, "Service late", "End other programs on this computer; bring the show home if it stays late.",
        action=X.STOP, past="Service was late",
    ),
    AlarmCause.LINKS_LATE: CauseRow(
        W,
        "Links late",
        "Check radios, antennas and what loads the network; bring the show home if it lasts.",
        action=X.STOP, past="Links were late",
    ),
    AlarmCause.OWN_FAILSAFE: CauseRow(
        W,
        "{vehicles} flown by an own failsafe",
        "Leave [it to its autopilot|them to their autopilots].",
        off_after_s=0.0,
    ),
    AlarmCause.PARAMETER_CHANGED: CauseRow(
        W,
        "{vehicles}: parameter changed",
        "Set it back; preflight fails until it is right.",
        off_after_s=0.0,
        past="{vehicles}: parameter was changed",
    ),
    AlarmCause.FENCE_DIFFERS: CauseRow(
        W,
        "{vehicles} without the site's fence",
        "Nothing but this station keeps [it|them] in the site: bring [it|them] home.",
        action=X.RETURN,
    ),
    AlarmCause.OUTSIDE_CONTROL: CauseRow(
        W,
        "{vehicles} outside control",
        "Ask the [pilot|pilots]. take-control takes [it|them] over, in HOLD, when the [pilot"
        " agrees|pilots agree].",
        off_after_s=0.0,
        action=X.TAKE_CONTROL,
    ),
    AlarmCause.INTERRUPTED: CauseRow(
        W, "Flight interrupted", "take-over or bring-home, where offered.", off_after_s=0.0,
        past="Flight was interrupted",
    ),
    AlarmCause.DUPLICATE_SYSTEM_ID: CauseRow(
        W, "System id used twice", "Switch one of them off, or give it its own id.",
        past="System id was used twice",
    ),
    AlarmCause.LINK_FAILED: CauseRow(
        W, "Link {about} failed", "Check cable, radio and port. The service keeps trying.",
        past="Link {about} had failed",
    ),
    AlarmCause.STATION_LOST: CauseRow(
        W,
        "Station {about} not received",
        "Watch its vehicles: without it they follow their own failsafe. Restart it, or restore the bus;"
        " its standby can take them over.",
        off_after_s=0.0,
        past="Station {about} was not received",
    ),
    AlarmCause.RETURN_UNPLANNED: CauseRow(
        W,
        "Return without a common plan",
        "Watch the vehicles: the return takes longer, and vehicles may wait for each other. Pause or land one"
        " that does not come home.",
        off_after_s=0.0,
        past="Return was without a common plan",
    ),
    AlarmCause.TARGET_STALE: CauseRow(C, "Live target not renewed", "Check what sends the target."),
    AlarmCause.TARGET_LOST: CauseRow(
        C,
        "Target {about} not tracked",
        "Check its source. If it says where the target is, select it again; or select another one.",
        on_after_s=0.3,
        past="Target {about} was not tracked",
    ),
    AlarmCause.TARGET_OUTRUNS: CauseRow(
        C,
        "Formation falls behind target {about}",
        "Let it slow down, or select another one; the formation follows at its own limit.",
        on_after_s=1.0,
        past="Formation fell behind target {about}",
    ),
    AlarmCause.TARGET_BEYOND: CauseRow(
        C,
        "Target {about} out of reach",
        "The formation follows along the fence. Select another target, or hold.",
        on_after_s=0.3,
        past="Target {about} was out of reach",
    ),
    AlarmCause.TARGET_SOURCES: CauseRow(
        C,
        "Sources of target {about} contradict each other",
        "Check which one is right, and switch the other off.",
        on_after_s=2.0,
        past="Sources of target {about} contradicted each other",
    ),
    AlarmCause.TARGET_NEAR: CauseRow(
        W,
        "{vehicles} too near the target",
        "Let the target stand, or go away from [the vehicle|the vehicles]; pause, or bring all home, if [it"
        " stays|they stay] there.",
        on_after_s=0.3,
        past="{vehicles} was too near the target",
    ),
    AlarmCause.TARGET_NO_ROOM: CauseRow(
        C,
        "No room above the target",
        "Make the sphere smaller, or the orbit wider.",
        on_after_s=1.0,
        past="There was no room above the target",
    ),
    AlarmCause.TRAFFIC_MANNED: CauseRow(
        E,
        "Manned aircraft {about} near",
        "Bring the show home, or land, if it comes nearer: it has the right of way.",
        action=X.STOP,
        past="Manned aircraft {about} was near",
    ),
    AlarmCause.TRAFFIC_NEAR: CauseRow(
        W,
        "Traffic {about} comes near",
        "Watch it; pause or land the show if it turns. Vehicles keep clear of it.",
        past="Traffic {about} was near",
    ),
    AlarmCause.TRAFFIC_CROWDED: CauseRow(
        C,
        "More traffic than is kept",
        "Vehicles keep clear of the nearest tracks only. Do not start; come home if more of it comes near.",
        past="There was more traffic than is kept",
    ),
    AlarmCause.TRAFFIC_UNKNOWN: CauseRow(
        C,
        "Traffic is not known",
        "Check its source. Until then watch the sky: nothing keeps clear of what is not reported.",
        on_after_s=0.3,
        past="Traffic was not known",
    ),
    AlarmCause.TAK_NOT_SENT: CauseRow(
        C,
        "Tracks not sent to {about}",
        "Users of TAK there do not see the vehicles. Check the address and the network.",
        on_after_s=3.0,
        past="Tracks were not sent to {about}",
    ),
    AlarmCause.REMOTE_ID: CauseRow(
        W,
        "{vehicles} without Remote ID",
        "Bring [it|them] home: [it is|they are] not seen by others. Look after [its transponder|their"
        " transponders].",
        on_after_s=1.0,
        action=X.RETURN,
    ),
    AlarmCause.OPERATOR_UNKNOWN: CauseRow(
        W,
        "Operator's place for Remote ID not known",
        "Look after the operator's receiver; autopilots refuse to arm without it.",
        on_after_s=1.0,
        past="Operator's place for Remote ID was not known",
    ),
    AlarmCause.OBSTACLE_NEAR: CauseRow(
        W,
        "{vehicles} too near obstacle {about}",
        "Check where the obstacle is. Pause the show if [it stays|they stay] there.",
        on_after_s=0.3,
        action=X.PAUSE,
    ),
    AlarmCause.OBSTACLE_WAITS: CauseRow(
        C, "Obstacle of the show does not stand yet", "Keep vehicles clear of it, or pause the show."
    ),
    AlarmCause.LAW_FAILED: CauseRow(
        W,
        "Law {about} failed",
        "Let all return home: the return does not need it. Choose another law on the ground.",
        action=X.STOP,
        past="Law {about} had failed",
    ),
    AlarmCause.NO_HEADWAY: CauseRow(
        C,
        "No headway past obstacle {about}",
        "Move the target, or remove the obstacle if it is gone; pause the show or let all return home"
        " otherwise.",
        action=X.PAUSE,
    ),
    AlarmCause.NO_WAY: CauseRow(
        C,
        "No way for {vehicles} past {about}",
        "Land [it|them] where [it is|they are], or get the links of the lost vehicles back.",
        action=X.LAND,
        past="{vehicles} had no way past {about}",
    ),
    AlarmCause.RADIUS_SMALL: CauseRow(
        C,
        "Radius too small for the accuracy of the positions",
        "Enlarge the radius, or bring the show home.",
        on_after_s=2.0,
        action=X.STOP,
    ),
    AlarmCause.UNCERTAIN_POSITION: CauseRow(
        C,
        "{vehicles} uncertain of [its position|their positions]",
        "Let [it|them] return home; check [its receiver|their receivers].",
        on_after_s=1.0,
        action=X.RETURN,
    ),
    AlarmCause.LITTLE_AUTHORITY: CauseRow(
        C,
        "Vehicles do not reach their velocities",
        "Bring the show home, or land it, if it lasts.",
        on_after_s=1.0,
        off_after_s=5.0,
        action=X.STOP,
    ),
    AlarmCause.SLOW_VEHICLE: CauseRow(
        C,
        "{vehicles} slower than configured",
        "Let [it|them] return home; compare MPC_XY_VEL_MAX with the configured speed.",
        off_after_s=5.0,
        action=X.RETURN,
    ),
    AlarmCause.SLOW_ANSWERS: CauseRow(
        C,
        "{vehicles} slow to follow setpoints",
        "Let [it|them] return home; compare the limits of acceleration with what preflight requires.",
        off_after_s=5.0,
        action=X.RETURN,
    ),
    AlarmCause.HEIGHT_DIFFERS: CauseRow(
        C,
        "{vehicles} not as high as reported",
        "Let [it|them] return home if the formation lacks room; then give all vehicles one source of height"
        " (EK3_SRC1_POSZ, EKF2_HGT_REF), or reboot [it|them] where [it stands|they stand].",
        off_after_s=5.0,
        action=X.RETURN,
    ),
    AlarmCause.MOVED_ON_PAD: CauseRow(
        C,
        "{vehicles} not where [it|they] stood",
        "Reboot [it where it stands|them where they stand]. Or look where [it stands|they stand], leave"
        " [it|them] out, and include [it|them] again: that confirms what [it reports|they report].",
        off_after_s=0.0,
        action=X.LEAVE_OUT,
    ),
    AlarmCause.CORRECTIONS_STOPPED: CauseRow(
        C,
        "Corrections for RTK stopped",
        "Check the base, its antenna and the network. The service keeps trying.",
    ),
    AlarmCause.TIMECODE: CauseRow(
        C,
        "Show not at its timecode",
        "Bring the timecode to where the show is, or pause the show."
        " gcs shows follow-external-clock no lets it run by this station's clock.",
        on_after_s=1.0,
    ),
    AlarmCause.WEATHER_DIFFERS: CauseRow(
        C,
        "More wind than was entered",
        "Enter the weather anew (gcs weather), and decide whether the show goes on.",
        on_after_s=3.0,
        off_after_s=5.0,
        past="There was more wind than was entered",
    ),
    AlarmCause.START_NOT_READY: CauseRow(
        W,
        "Counting down, but not ready",
        "Mend what is named, or call the countdown off: stop. Otherwise the start is refused at its time.",
        off_after_s=0.0,
        past="A start that was counted down was not ready",
    ),
    AlarmCause.CLOCK_DOUBTFUL: CauseRow(
        C,
        "Clock of this machine may be wrong",
        "The show begins by it: synchronise it (chrony, systemd-timesyncd), or start by hand.",
    ),
    AlarmCause.SILENT: CauseRow(
        C,
        "{vehicles} not received",
        "Check power, link and ids of [it|them], or leave [it|them] out of the show.",
        on_after_s=1.0,
        off_after_s=0.0,
        action=X.LEAVE_OUT,
    ),
    AlarmCause.POOR_LINK: CauseRow(
        C,
        "{vehicles} with a poor link",
        "Check antennas and distance; let [it|them] return home if it gets worse.",
        on_after_s=8.0,
        action=X.RETURN,
    ),
    AlarmCause.NO_HEARTBEAT: CauseRow(
        C,
        "{vehicles} without heartbeat",
        "[Its mode is not known: a pilot may have it. Watch it|Their modes are not known: pilots may"
        " have them. Watch them]; check antennas and distance.",
        off_after_s=0.0,
    ),
    AlarmCause.INPUT_FLOODED: CauseRow(
        C, "Input {about} flooded", "Find what sends there, and stop it. What is too much is dropped unread."
    ),
    AlarmCause.RECORD_FAILS: CauseRow(
        C, "Not recorded", "Free the disk or make it writable: recording goes on by itself.", off_after_s=0.0
    ),
    AlarmCause.SUPERVISOR_GONE: CauseRow(
        C, "Supervisor gone", "Nothing restarts this service: land soon and start it anew.", off_after_s=0.0
    ),
    AlarmCause.NOT_FLYING: CauseRow(
        I, "{vehicles} not flying", "include takes an excluded vehicle into the show again.", off_after_s=0.0,
        action=X.INCLUDE,
    ),
    AlarmCause.STACKED: CauseRow(
        I, "Stacked pairs", "A larger radius, or another number of vehicles, avoids it.",
        off_after_s=0.0,
    ),
    AlarmCause.SERVICE_NOTE: CauseRow(I, "Note", "See the service's log.", off_after_s=0.0),
    AlarmCause.REPLAY: CauseRow(I, "Replay", "Nothing here flies.", off_after_s=0.0),
}  # fmt: skip


class OverallSeverity(StrEnum):
    """The most severe of the alarms whose cause lasts."""

    EMERGENCY = "emergency"
    WARNING = "warning"
    CAUTION = "caution"
    INFORMATION = "information"
    NORMAL = "normal"  # no such alarm


_FORMS: Final = re.compile(r"\[([^|\]]*)\|([^\]]*)\]")

RANK: Final = {severity: rank for rank, severity in enumerate(AlarmSeverity)}
"""Rank of each severity; 0 is the most severe."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition that holds at this instant, as its source reports it."""

    cause: AlarmCause
    because: str  # in words, without a full stop: "no telemetry for 2.0 s"
    vehicles: tuple[VehicleId, ...] = ()
    consequence: str = ""  # what follows automatically, a sentence or more, as `for_number` takes it
    advice: str = ""  # what an operator can do, as `for_number` takes it; empty: as in `CAUSES`
    severity: AlarmSeverity | None = None  # None: as in `CAUSES`
    about: str = ""  # name of the link, file or obstacle: each has its own alarm
    command_id: str | None = None  # of the command that the service gave because of it
    action: AlarmAction | None = None  # does what `advice` says; of the cause, where that has none
    replaces: tuple[AlarmCause, ...] = ()  # alarms of the same that this one goes on with: they are not over


@dataclass(frozen=True, slots=True)
class VehicleReason:
    """Why an alarm concerns one of its vehicles."""

    vehicle: VehicleId
    because: str


@dataclass(frozen=True, slots=True)
class Alarm:
    """One condition that an operator should know, with all vehicles that it concerns."""

    __pydantic_config__ = PUBLISHED

    id: Annotated[str, Field(examples=["vehicle-lost-7"])]
    severity: Annotated[
        AlarmSeverity,
        Field(
            description="emergency: act at once; warning: act soon; caution: be ready to act; information:"
            " nothing to do."
        ),
    ]
    cause: Annotated[
        AlarmCause,
        Field(
            description="For programs; docs/operations/in-flight.md lists them.", examples=["vehicle-lost"]
        ),
    ]
    text: Annotated[
        str,
        Field(
            description="The cause first, its consequence after.",
            examples=["Vehicle d3 lost: no telemetry for 2.0 s. Formation closes the gap."],
        ),
    ]
    advice: Annotated[str, Field(description="What an operator can do.")]
    vehicles: Annotated[
        tuple[VehicleId, ...], Field(description="All that it concerns; empty: it concerns no vehicle.")
    ]
    since_unix_time_s: Annotated[float, Field(description="When the cause began.")]
    raised_unix_time_s: Annotated[
        float,
        Field(
            description="When it began, or last concerned a further vehicle or became more severe: it then is"
            " no longer acknowledged. The newest of a severity is listed first."
        ),
    ]
    command_id: Annotated[
        str | None, Field(description="The command that the service gave because of it; null: none.")
    ] = None
    acknowledged_by: Annotated[
        str | None, Field(description="Name of the token used; null: not acknowledged.")
    ] = None
    acknowledged_unix_time_s: float | None = None
    reasons: Annotated[
        tuple[VehicleReason, ...],
        Field(description="Why it concerns each of its vehicles, where the text has no room for it."),
    ] = ()
    action: Annotated[
        AlarmAction | None, Field(description="The command that does what `advice` says; null: none does.")
    ] = None
    ended_unix_time_s: Annotated[
        float | None,
        Field(
            description="null: the cause lasts. Emergencies and warnings stay listed after their cause has"
            " ended until they are acknowledged; they do not count for the state of the whole."
        ),
    ] = None

    @property
    def lasts(self) -> bool:
        return self.ended_unix_time_s is None


def in_the_past(row: CauseRow) -> str:
    """The headline of an alarm that has ended."""
    return row.past or row.headline.replace("{vehicles}", "{vehicles} [was|were]", 1)


def for_number(text: str, *, many: bool) -> str:
    """Choose from each `[one|several]` in a text the form for one vehicle, or for several."""
    return _FORMS.sub(lambda forms: forms[2 if many else 1], text)


def ordered(alarms: Iterable[Alarm]) -> tuple[Alarm, ...]:
    """Sort by lasting before ended, then most severe first, then newest first."""
    return tuple(
        sorted(alarms, key=lambda alarm: (not alarm.lasts, RANK[alarm.severity], -alarm.raised_unix_time_s))
    )


def overall(alarms: Iterable[Alarm]) -> OverallSeverity:
    """Return the overall severity; alarms whose cause has ended do not count."""
    worst = min((RANK[alarm.severity] for alarm in alarms if alarm.lasts), default=None)
    return OverallSeverity.NORMAL if worst is None else OverallSeverity(list(AlarmSeverity)[worst])


@dataclass(frozen=True, slots=True)
class Limit:
    """Two thresholds. With `off` above `on` low values are bad, otherwise high values."""

    on: float
    off: float


def beyond(before: Mask, values: Array, limit: Limit) -> Mask:
    """(n,) Which values are beyond the limit; those between the thresholds keep their state `before`.

    An unknown value (NaN) is not beyond.
    """
    if limit.off > limit.on:  # low values are bad
        return np.asarray((values < limit.on) | (before & (values < limit.off)))
    return np.asarray((values > limit.on) | (before & (values > limit.off)))
