"""The table of all commands: their names, their texts, and their modules as strings.

This module imports no other module of ours, so that `gcs --help`, a mistyped command and a kill start as fast
as Python itself. A new command is a line in `COMMANDS` (a module of its own) or in `CALLS` (one call of the
REST API).
"""

from typing import Final, NamedTuple

DOCUMENT: Final = "print one JSON document, also of an error"
LINES: Final = "print JSON, one object a line, also of an error"
WATCHED: Final = "print one JSON document, with --watch one a line; also of an error"


class CliCommand(NamedTuple):
    """A command with functions of its own, in modules of `gcs.cli`.

    `run_NAME` of `module` executes it; `add_NAME_arguments` of `options`, or of `module`, fills its parser.
    `json` says what it prints with `--json`, which every command accepts. `error_code` is its exit code for
    every error; None: that of the error.
    """

    module: str
    text: str
    json: str = DOCUMENT
    options: str | None = None
    error_code: int | None = None


class ApiCall(NamedTuple):
    """One call of the REST API: a method of `gcs.client.Client`, or of an object in one of its attributes.

    The method's parameters are the arguments. Keyword-only parameters become options, except those in
    `positional`: they become positional. With `alone` the command has only the parameters in `positional`.
    """

    name: str
    method: str
    text: str
    positional: tuple[str, ...] = ()
    alone: bool = False


class ActionCommand(NamedTuple):
    """A command for named vehicles; with `all_` also for all to which it can apply."""

    name: str
    text: str
    all_: bool = True


OPTIONS: Final = "options"
"""The module with the arguments of commands that have slow modules of their own."""

COMMANDS: Final = {
    "demo": CliCommand("demo.demo", "fly the whole story with an embedded fake fleet", LINES, OPTIONS),
    "serve": CliCommand("service.serve", "run the service and its REST API", LINES, OPTIONS),
    "show": CliCommand(
        "shows.show_command", "check, draw, hash, import, sample, place, export show files", options=OPTIONS
    ),
    "site": CliCommand(
        "sites.site_command", "check and convert a site, compute its volumes, report on it", options=OPTIONS
    ),
    "params": CliCommand(
        "params", "check or set the vehicles' parameters that decide what is safe", options=OPTIONS
    ),
    "law": CliCommand("law", "list, begin, check and choose the formation's laws", options="law"),
    "simulate": CliCommand("simulate", "fly scenarios in virtual time and judge them", LINES, OPTIONS),
    "replay": CliCommand("replay", "show a recorded flight through the API, as if live", LINES, OPTIONS, 2),
    "report": CliCommand(
        "flight_report", "judge a recorded flight: separation, fence, limits", options=OPTIONS, error_code=2
    ),
    "key": CliCommand("local_files", "make keys for MAVLink signatures, and for the stations of a site"),
    "token": CliCommand("local_files", "make, list and revoke tokens for the API", error_code=1),
    "status": CliCommand("status", "the fleet of a running service, as a table", WATCHED),
    "stations": CliCommand("status", "the stations of a site, and which of them leads", WATCHED),
    "alarms": CliCommand("alarms", "what an operator should know now, the most severe first", WATCHED),
    "acknowledge": CliCommand("alarms", "say that an alarm was seen"),
    "preflight": CliCommand("status", "what a start would find"),
    "kill": CliCommand("kill.kill", "stop motors now, even in the air; works without the service"),
    "timecode": CliCommand("timecode", "read linear timecode from sound, and send it on", LINES),
    "sim": CliCommand("main", "run a fake fleet or target alone, as python -m gcs.sim does", LINES),
    "completion": CliCommand("main", "print what a shell needs to complete gcs"),
    "files": CliCommand("local_files", "documents, dashboard and unit file that came along"),
}

_BOX: Final = ("x_m", "y_m", "half_length_x_m", "half_length_y_m", "height_m")

CALLS: Final = (
    ApiCall("start", "start", "start the vehicles named, or all that are not left out"),
    ApiCall("confirm", "confirm", "confirm the start that another token proposed, by its hash"),
    ApiCall("go", "go", "what a start needs of people: the proposed start, checklists, weather"),
    ApiCall("sign", "sign", "sign items of a role's checklist, by their numbers"),
    ApiCall("reopen", "reopen", "take signatures of a checklist back"),
    ApiCall("weather", "enter_weather", "enter the weather as it is now"),
    ApiCall("stop", "stop", "all vehicles return home and land"),
    ApiCall("pause", "pause", "the formation stands still"),
    ApiCall("resume", "resume", "go on after a pause"),
    ApiCall("abort", "abort", "all vehicles descend to distinct places, now"),
    ApiCall("interrupted", "interrupted", "the flight that was cut off, and what it offers"),
    ApiCall(
        "take-over", "take_over", "go on with a flight that was cut off: into the formation, which stands"
    ),
    ApiCall("bring-home", "bring_home", "vehicles of a flight that was cut off return home and land"),
    ApiCall("formation", "formation", "radius, height and law"),
    ApiCall("radius", "change_formation", "change the formation's radius", ("radius_m",), alone=True),
    ApiCall(
        "height", "change_formation", "change the height of the formation's centre", ("height_m",), alone=True
    ),
    ApiCall("target show", "target", "where the target is now"),
    ApiCall("target set", "set_target", "say where the target is, in the show frame"),
    ApiCall("target set-geodetic", "set_target_geodetic", "say where the target is, on the globe"),
    ApiCall("target list", "targets", "the targets that can be followed, and how well each is known"),
    ApiCall("target select", "select_target", "follow a target of the configuration"),
    ApiCall("target hold", "hold_target", "follow none of them: the target stands where it is"),
    ApiCall("target report", "report_target", "say where a target is that has a source of kind rest"),
    ApiCall("traffic", "traffic", "other traffic, and how near it comes"),
    ApiCall("orbit show", "orbit", "how the formation circles the target"),
    ApiCall("orbit set", "change_orbit", "change radius, speed or direction"),
    ApiCall("yaw show", "yaw", "where the vehicles head"),
    ApiCall("yaw set", "change_yaw", "change where the vehicles head"),
    ApiCall("obstacle list", "obstacles", "every obstacle"),
    ApiCall("obstacle show", "obstacle", "one obstacle"),
    ApiCall("obstacle add", "add_obstacle", "add a box; without an id it is given one", _BOX),
    ApiCall("obstacle change", "change_obstacle", "replace the box of this id", _BOX),
    ApiCall("obstacle remove", "remove_obstacle", "forget a box"),
    ApiCall("shows list", "shows.stored", "every show file that the service keeps"),
    ApiCall("shows text", "shows.text", "a show file, as it was uploaded"),
    ApiCall("shows upload", "shows.upload", "keep a show file under a name"),
    ApiCall("shows import", "shows.import_drawing", "make a show of a drawing, the file of another program"),
    ApiCall("shows drawing", "shows.drawing", "where the vehicles of a drawn show are, and their colours"),
    ApiCall(
        "shows placement", "shows.placement", "where a drawn show lies, and the vehicles beside its pads"
    ),
    ApiCall("shows place", "shows.place", "move and turn a drawn show with its pads"),
    ApiCall("shows remove", "shows.remove", "forget a show file"),
    ApiCall("shows check", "shows.check", "begin the check of a show"),
    ApiCall("shows checked", "shows.checked", "how far the newest check has got"),
    ApiCall("shows select", "shows.select", "have a checked show fly next"),
    ApiCall("shows deselect", "shows.deselect", "fly without a show"),
    ApiCall("shows seek", "shows.seek", "have the selected show begin at a cue"),
    ApiCall("shows begin", "shows.begin", "have the selected show begin to move at a clock time"),
    ApiCall("shows cancel-begin", "shows.cancel_begin", "cancel that time"),
    ApiCall(
        "shows follow-external-clock",
        "shows.follow_external_clock",
        "yes: shows run by the timecode, no: by the station's clock",
    ),
    ApiCall("areas show", "site.stored", "the site as its file has it, and whether it is in force"),
    ApiCall("areas text", "site.text", "the same as a file: geojson, kml or plan"),
    ApiCall("areas change", "site.change", "replace the site by a file of GeoJSON, on the ground"),
    ApiCall("exclude", "preflight.exclude", "take a vehicle out of the show, on the ground"),
    ApiCall("include", "preflight.include", "take an excluded vehicle into the show again"),
    ApiCall("playback show", "playback.now", "how the record is played, and where it is"),
    ApiCall("playback set", "playback.change", "pause the record, change its speed or position"),
    ApiCall("playback report", "playback.report", "what the flight kept and broke; ask until it is done"),
    ApiCall("command list", "commands", "the last commands, the newest first"),
    ApiCall("command show", "command_record", "the outcome of a command"),
    ApiCall("lead take", "take_lead", "have the station that is asked lead the site from now on"),
    ApiCall(
        "station take-over", "take_over_station", "fly on with a lost station's vehicles, as its standby"
    ),
    ApiCall("state", "fleet", "everything at one instant"),
    ApiCall("phase", "show", "where the show stands"),
    ApiCall("marks", "marks", "phases, commands and alarms of this flight, or of the record"),
    ApiCall("facts", "status", "what changes seldom: the fence, home places, cues, events"),
    ApiCall("features", "features", "what each feature beside the formation reports"),
    ApiCall("whoami", "access", "the token's name, and what it may do"),
    ApiCall("vehicle list", "vehicles", "every vehicle"),
    ApiCall("vehicle show", "vehicle", "one vehicle"),
    ApiCall("health", "health", "whether control is alive; exit code 3 when it is not"),
    ApiCall("ready", "readiness", "whether any vehicle can be commanded; else exit code 3"),
    ApiCall("metrics", "metrics", "every metric, in Prometheus' text format"),
)

GROUPS: Final = {
    "target": "where the target is",
    "orbit": "how the formation circles the target",
    "yaw": "where the vehicles head",
    "obstacle": "what the fleet keeps clear of",
    "shows": "show files that the service keeps, and the one that is flown next",
    "areas": "the areas of the service's site; gcs site works on files alone",
    "playback": "how gcs replay plays its record, and what the flight kept",
    "command": "what was commanded, and what became of it",
    "vehicle": "what is known of each vehicle",
    "lead": "which station of a site leads: gcs stations lists them",
    "station": "the vehicles of a lost station, at its standby: gcs stations lists them",
}

ACTIONS: Final = (
    ActionCommand("hold", "vehicles leave the formation and hold position"),
    ActionCommand("join", "vehicles that hold come back into the formation"),
    ActionCommand("return", "vehicles return home and land"),
    ActionCommand("land", "vehicles land where they are; without names all do, as abort"),
    ActionCommand("take-control", "take control of vehicles in the air; they hold"),
    ActionCommand("confirm-down", "say that lost vehicles were seen on the ground", all_=False),
    ActionCommand("find", "let vehicles on the ground blink", all_=False),
)


def names() -> dict[str, str]:
    """Return the first word of every command, and its text."""
    first = {name: command.text for name, command in COMMANDS.items()}
    for call in CALLS:
        group, _, _ = call.name.rpartition(" ")
        first[group or call.name] = GROUPS[group] if group else call.text
    return first | {action.name: action.text for action in ACTIONS}
