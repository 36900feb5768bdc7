"""Every state of the console: a service without vehicles in that state, and what an operator opens."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, TypeAlias

from playwright.sync_api import Browser, expect

from gcs.api.auth.authorization import Authorization
from gcs.api.auth.tokens import Tokens, create_token
from gcs.areas.site import AreaKind
from gcs.model.interrupted_flight import InterruptedFlight, Offer, Remaining
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Obstacle
from gcs.model.preflight_report import Check, Exclusion, State
from gcs.service import (
    BeginState,
    BeginView,
    CommandMark,
    CueMark,
    EventMark,
    FlightMarks,
    IdleSpan,
    PhaseSpan,
    SelectedShow,
    ShowAction,
)
from gcs.service.access import Role
from gcs.service.alarms import CAUSES, AlarmCause, AlarmSeverity, Condition
from gcs.service.event_log import Severity
from gcs.service.features import (
    CorrectionsView,
    Features,
    LightsView,
    TargetsView,
    TargetView,
    TimecodeView,
    TrackView,
    TrafficView,
)
from gcs.service.go import WeatherEntry
from gcs.shows.formats import write_drawing
from tests.support.api_background import Ticking, in_background
from tests.support.api_fake_service import FakeService
from tests.support.console_bench import SOON_MS, Console, console
from tests.support.drawn_shows import drawn_show
from tests.support.fields import area, field
from tests.support.replays import FakeRecord

Prepare: TypeAlias = Callable[[FakeService], object]
Act: TypeAlias = Callable[[Console], object]

COUNT: Final = 6
MAST: Final = ((40, 0), (40, 10), (50, 10), (50, 0))
CUES: Final = tuple(CueMark(cue, at_s) for cue, at_s in (("gather", 0.0), ("turn", 20.0), ("wide", 45.0)))


def nothing(_of: object) -> None:
    """As it is."""


@dataclass(frozen=True, slots=True)
class ConsoleState:
    """How to get there, and what is on the page then."""

    name: str
    shown: str  # a part of the page that only this state has
    prepare: Prepare = nothing
    act: Act = nothing
    count: int = COUNT
    stations: tuple[str, ...] = ()
    role: Role | None = None  # None: without tokens
    life: str = "Live"


def flown(phase: ShowPhase, of_vehicles: Phase) -> Prepare:
    """The show and all its vehicles in one phase."""

    def prepare(service: FakeService) -> None:
        service.show = phase
        service.phases |= dict.fromkeys(service.phases, of_vehicles)

    return prepare


running: Final = flown(ShowPhase.RUNNING, Phase.FORMATION)


def mixed(service: FakeService) -> None:
    """A vehicle in each phase that there is."""
    running(service)
    service.phases |= dict(zip(service.phases, Phase, strict=False))


def fails(service: FakeService) -> None:
    """Several causes, a vehicle that an operator has excluded, and one that is silent."""
    fix = Check(
        "fix",
        State.FAIL,
        2.0,
        "",
        "GPS_FIX_TYPE at least 3",
        "its receiver's fix is 2D, 3D is needed",
        "wait",
    )
    near = Check(
        "distance to the next",
        State.FAIL,
        3.1,
        "m",
        "at least 4.3 m",
        "stands 3.1 m from d3, at least 4.3 m is needed",
        "move d2 and d3 1.2 m farther apart",
        ("d3", "d2"),
    )
    clock = Check(
        "clock", State.UNKNOWN, None, "s", "at most 1 s", "its clock has not reported the time yet", "wait"
    )
    service.failing = {"d3": (fix,), "d2": (near,), "d5": (clock,), "d6": (clock,)}
    service.excluded["d4"] = Exclusion("anna", "propeller", time.time())


def selected(
    service: FakeService, *, name: str = "parade", runs: bool = False, begin: BeginView | None = None
) -> None:
    """A written show with three cues."""
    service.selected = SelectedShow(
        name, "a1b2", "turn", tuple(each.cue for each in CUES), 31.0, 70.0,
        runs=runs, target_is_live=runs, timeline=CUES, begin=begin,
    )  # fmt: skip


def night_selected(service: FakeService) -> None:
    """As it was before the file that is uploaded."""
    selected(service, name="night")


def show_runs(service: FakeService) -> None:
    running(service)
    selected(service, runs=True)


def begins(service: FakeService) -> None:
    """In the air, before its time."""
    flown(ShowPhase.ASSEMBLING, Phase.HOLD)(service)
    selected(service, begin=BeginView(BeginState.WAITING, time.time() + 95.0, 95.0))


def counts_down(service: FakeService) -> None:
    service.show, service.start_unix_s = ShowPhase.COUNTDOWN, time.time() + 95.0


def timecode(*, frozen: bool) -> Prepare:
    def prepare(service: FakeService) -> None:
        show_runs(service)
        service.features = Features(
            timecode=TimecodeView(
                "rtp-midi://0.0.0.0:5004", followed=True, state="lost" if frozen else "running",
                label="01:00:31:12", frame_rate="25", age_s=4.0 if frozen else 0.04, behind_s=0.02, slope=1.0,
                tempo=0.0 if frozen else 1.0, problem="the timecode is lost" if frozen else "", readings=900,
                garbage=0, dropped=0, frozen_since_unix_time_s=time.time() - 4.0 if frozen else None,
            )
        )  # fmt: skip

    return prepare


def targets(service: FakeService) -> None:
    """Two targets, one of which is followed."""
    running(service)
    service.features = Features(
        targets=TargetsView(
            "boat",
            (
                TargetView(
                    "boat", "nmea", "tracked", "", 0.2, 5.0, 12.0, 4.0, 1.2, -0.4, 0.3, nan, 10.0, 300, 2
                ),
                TargetView(
                    "walker", "cot", "tracked", "", 0.4, 1.0, -8.0, 9.0, 0.5, 0.5, 1.5, 3.0, 0.0, 60, 0
                ),
            ),
            off_m=0.42,
        )
    )


def traffic(service: FakeService) -> None:
    """An aircraft that is near and evaded, and a source that fails."""
    running(service)
    plane = TrackView(
        "3C6444", "manned", 300.0, 40.0, 90.0, -30.0, 0.0, 0.0, 3.0, 0.5, 290.0, 30.0, 9.0,
        evaded=True, near=True,
    )  # fmt: skip
    service.features = Features(
        traffic=TrafficView(1, 1, 1, "nothing arrives at udp://0.0.0.0:14560", 10, 0, 30.0, 15.0, (plane,))
    )


def proposed(service: FakeService) -> None:
    """A start that another token proposed, checklists of which one item is open, no weather."""
    service.sign("pads", [2])
    service.propose("alice", time.time() + 42.0)


def not_signed(service: FakeService) -> None:
    """NO GO: open checklists, no weather, and a proposal that is over."""
    service.propose("alice")
    service.call_off("checklists have changed since alice proposed it")


def all_signed(service: FakeService) -> None:
    """Checklists and weather are complete; no start is proposed."""
    service.sign("pads", [1, 2])
    service.enter_weather(WeatherEntry(4.0, 6.5, 5000.0, 2.0))


def countdown_not_ready(service: FakeService) -> None:
    counts_down(service)
    reason = "d3: battery at 15%, at least 25% is needed"
    service.conditions = (Condition(AlarmCause.START_NOT_READY, reason),)


def corrections(problem: str) -> Prepare:
    def prepare(service: FakeService) -> None:
        running(service)
        service.features = Features(
            lights=LightsView("led-control", sent=120, dropped=30),
            corrections=CorrectionsView(
                "ntrip://192.0.2.7:2101/BASE", 12.0 if problem else 0.8, problem, 47.3977, 8.5456, 488.0,
                messages=300, received_bytes=90_000, sent=1200, dropped=3,
            ),
        )  # fmt: skip

    return prepare


def alarmed(*causes: AlarmCause) -> Prepare:
    """In flight with these alarms."""

    def prepare(service: FakeService) -> None:
        running(service)
        service.conditions = tuple(
            Condition(
                cause,
                "this is why, in as many words as the reason usually has",
                tuple(service.phases)[: 1 + number % 3],
                "What follows by itself.",
                about="wall",
            )
            for number, cause in enumerate(causes)
            if cause is not AlarmCause.CONTROL_STOPPED  # the API itself raises it
        )

    return prepare


def ended(service: FakeService) -> None:
    alarmed(AlarmCause.VEHICLE_LOST, AlarmCause.WIND, AlarmCause.POOR_LINK)(service)
    service.book.look(service.conditions, time.monotonic() - 60.0, time.time() - 60.0)
    service.book.look(service.conditions, time.monotonic() - 50.0, time.time() - 50.0)
    service.acknowledge(next(each.id for each in service.book.alarms if each.cause is AlarmCause.WIND))
    service.conditions = service.conditions[1:]


def interrupted(service: FakeService) -> None:
    service.phases |= dict.fromkeys(service.phases, Phase.HOLD)
    service.interrupted = InterruptedFlight(
        "2026-06-01", time.time() - 40.0, ShowPhase.RUNNING, None,
        {name: Remaining(Phase.FORMATION, pad_known=True, waits=True, text="waits in mode hold")
         for name in service.phases},
        (Offer.TAKE_OVER, Offer.BRING_HOME), (), "the service stalled for 4.4 s", stalled=True,
    )  # fmt: skip


def happened(service: FakeService) -> None:
    """Events of every severity, and commands with every outcome."""
    running(service)
    for severity in Severity:
        service.happen(f"something of severity {severity}", "d1")
        service.happened = (*service.happened[:-1], replace(service.happened[-1], severity=severity))
    service.command_log.open(ShowAction.PAUSE, list(service.phases), {})
    done = service.command_log.open(ShowAction.RESUME, list(service.phases), {"d6": "it is lost"})
    service.finish(done.id)


def obstacles(service: FakeService) -> None:
    service.plan.add_obstacle(Obstacle("tower", 20.0, 5.0, 4.0, 3.0, 30.0))
    service.plan.add_obstacle(Obstacle("van", -12.0, 5.0, 2.0, 1.0, 3.0, 0.5, 0.0))


def station_lost(service: FakeService) -> None:
    running(service)
    service.lead = "south"
    service.silent_s["south"] = 4.0


def replayed(service: FakeService) -> None:
    show_runs(service)
    service.marks = FlightMarks(
        time.time() - 60.0,
        (PhaseSpan(ShowPhase.ASSEMBLING, 0.0, 20.0), PhaseSpan(ShowPhase.RUNNING, 20.0, 50.0)),
        CUES,
        (CommandMark(20.0, "pause", "pause by anna", None),),
        (
            EventMark(12.0, Severity.WARNING, "a1", AlarmSeverity.WARNING, "d1 is late", "d1"),
            EventMark(30.0, Severity.ERROR, None, None, "d2 is lost", None),
        ),
        (IdleSpan(50.0, 60.0),),
    )
    service.replaying = FakeRecord()


def tools(ui: Console) -> None:
    """The second row of the top bar, where it has one."""
    expect(ui.part("who")).to_be_attached()
    if not ui.part("who").is_visible():
        ui.opens(lambda: ui.press("tools"), "who")


def panel(name: str, *presses: str) -> Act:
    """Open a panel, and press these one after the other."""

    def act(ui: Console) -> None:
        if ui.part(f"panel-{name}").count() == 0:
            ui.opens(lambda: ui.press(f"tab-{name}"), f"panel-{name}")
        for each in presses:
            ui.press(each)

    return act


def keyed(key: str, shown: str, *presses: str) -> Act:
    """Press a key until a part of the page is there, and then press these."""

    def act(ui: Console) -> None:
        if ui.part(shown).count() == 0:
            ui.opens(key, shown)
        for each in presses:
            ui.press(each)

    return act


def filled(act: Act, **fields: str) -> Act:
    """Type into fields; `__` in a name stands for a colon."""

    def both(ui: Console) -> None:
        act(ui)
        for name, text in fields.items():
            ui.part(name.replace("__", ":").replace("_of_", "-")).fill(text)

    return both


@cache
def night_skyc() -> bytes:
    """A drawing for these vehicles."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "night.skyc"
        write_drawing(drawn_show(COUNT, 20.0, 3.0, ("rings",)), path)
        return path.read_bytes()


def uploads(ui: Console, name: str, content: bytes) -> None:
    """Upload a file in the panel of shows, until it is listed."""
    panel("shows")(ui)
    ui.part("show-upload").set_input_files({"name": name, "mimeType": "text/plain", "buffer": content})
    expect(ui.part(f"show-{Path(name).stem}")).to_be_visible(timeout=SOON_MS)


def bad_show(ui: Console) -> None:
    """A file that is no show, with what its check found."""
    uploads(ui, "broken.yaml", b"about: Nothing.\nfleet: {vehicles: many}\n")
    expect(ui.part("show-problems")).to_be_visible(timeout=SOON_MS)


def previewed(ui: Console) -> None:
    if ui.part("drawn").count() == 0:
        uploads(ui, "night.skyc", night_skyc())
        expect(ui.part("drawn")).to_be_visible(timeout=SOON_MS)


def placed(ui: Console) -> None:
    previewed(ui)
    panel("shows")(ui)
    ui.opens(lambda: ui.press("show-place-night"), "placing")


def with_site(service: FakeService) -> None:
    """A field with an audience beside it, and a mast in it."""
    service.keep_site(field(area(AreaKind.NO_FLY, MAST, name="mast")))


def site_edited(ui: Console) -> None:
    """A site with an area that was added."""
    panel("feature-site", "site-edit", "site-add-no-fly")(ui)
    expect(ui.part("site-choose-3")).to_be_visible(timeout=SOON_MS)


def site_refused(ui: Console) -> None:
    """A site that is edited, whose sides cross; the service says where."""
    panel("feature-site", "site-edit")(ui)
    ui.part("site-x").fill("120")
    ui.part("site-y").fill("-20")
    ui.part("site-y").press("Enter")
    ui.press("site-save")
    expect(ui.part("site-problems")).to_be_visible(timeout=SOON_MS)


def obstacle_previewed(ui: Console) -> None:
    """An obstacle that is drawn and not sent; its form is closed."""
    if ui.part("panel-obstacles").count() == 0:
        panel("obstacles", "obstacle-add")(ui)
    ui.closes(lambda: ui.press("tab-obstacles"), "panel-obstacles")


def refused(ui: Console) -> None:
    """A command that the page refuses, and one that is done."""
    ui.page.keyboard.press("Shift+S")
    ui.page.keyboard.press("Shift+P")


def entered(token: str) -> Act:
    def act(ui: Console) -> None:
        if ui.part("token").count():
            ui.part("token").fill(token)
            ui.page.keyboard.press("Enter")

    return act


def folded(ui: Console) -> None:
    """From the top: what the list's heading covers is scrolled to."""
    panel("fleet", "alarms-all", "alarms-fold")(ui)
    ui.page.locator(".alarms").evaluate("(list) => { list.scrollTop = 0; }")


def some_selected(ui: Console) -> None:
    panel("fleet")(ui)
    ui.part("fleet-scroll").focus()
    for key in ("Home", "ArrowDown", "Shift+ArrowDown"):
        ui.page.keyboard.press(key)


def group_page(ui: Console) -> None:
    some_selected(ui)
    ui.press("selection-open")


def vehicle_page(ui: Console) -> None:
    panel("fleet")(ui)
    ui.part("fleet-scroll").focus()
    for key in ("Home", "Enter"):
        ui.page.keyboard.press(key)


SITE: Final = ("north", "south")
BY_SEVERITY: Final = {
    severity: [c for c in AlarmCause if CAUSES[c].severity is severity] for severity in AlarmSeverity
}

STATES: Final = (
    # without data, and who may do what
    ConsoleState("lost", "banner", life="No connection"),
    ConsoleState("control-stopped", "banner", running, life="Control stopped"),
    ConsoleState("login", "login", role=Role.WATCH, life="Access denied"),
    ConsoleState("login-refused", "login", act=entered("gcs_guess"), role=Role.WATCH, life="Access denied"),
    *(ConsoleState(f"role-{role}", "who", running, tools, role=role) for role in Role),
    # on the ground
    ConsoleState("idle", "start"),
    ConsoleState("no-vehicle", "start", flown(ShowPhase.IDLE, Phase.OFFLINE)),
    ConsoleState("not-ready", "preflight-todo", fails, panel("preflight")),
    ConsoleState("all-checks", "check-pass", act=panel("preflight", "checks-all")),
    ConsoleState("excluding", "exclude-reason", fails, panel("preflight", "exclude-d3")),
    ConsoleState("start-ready", "start-go", act=keyed("Shift+S", "start-go")),
    ConsoleState("start-not-ready", "start-go", fails, keyed("Shift+S", "start-go")),
    ConsoleState(
        "start-at",
        "start-time",
        selected,
        filled(
            keyed("Shift+S", "start-go", "start-when-at", "start-who-named", "begin-when-at"),
            start_of_time="soon",
            start_of_names="d1 d99",
            begin_of_time="never",
        ),
    ),
    ConsoleState("countdown", "countdown", counts_down),
    ConsoleState("countdown-not-ready", "countdown", countdown_not_ready),
    ConsoleState("proposed", "go-confirm", proposed, panel("feature-go")),
    ConsoleState("no-go", "go-missing", not_signed, panel("feature-go")),
    ConsoleState(
        "weather",
        "go-panel",
        all_signed,
        filled(panel("feature-go"), weather__gust_m_s="7.5", weather__kp="x"),
    ),
    # in the air
    *(
        ConsoleState(f"show-{show}", "show-phase", flown(show, vehicles))
        for show, vehicles in (
            (ShowPhase.PREFLIGHT, Phase.STANDBY),
            (ShowPhase.ARMING, Phase.TAKEOFF),
            (ShowPhase.ASSEMBLING, Phase.HOLD),
            (ShowPhase.RUNNING, Phase.FORMATION),
            (ShowPhase.PAUSED, Phase.HOLD),
            (ShowPhase.RETURNING, Phase.RETURN),
            (ShowPhase.ABORTING, Phase.LANDING),
            (ShowPhase.LANDED, Phase.STANDBY),
        )
    ),
    ConsoleState("written-show", "timeline", show_runs),
    ConsoleState("begins", "begins", begins),
    ConsoleState(
        "begin-sheet", "begin-time", begins, filled(panel("fleet", "begin"), begin_of_time="21:30:00")
    ),
    ConsoleState("timecode", "timecode", timecode(frozen=False)),
    ConsoleState("timecode-frozen", "frozen-for", timecode(frozen=True)),
    ConsoleState("traffic", "traffic", traffic, panel("feature-traffic")),
    ConsoleState("corrections", "corrections", corrections("")),
    ConsoleState("corrections-stopped", "corrections", corrections("nothing for 12 s")),
    ConsoleState("interrupted", "take-over", interrupted),
    # alarms
    *(
        ConsoleState(f"alarms-{severity}", "alarms", alarmed(*BY_SEVERITY[severity]))
        for severity in AlarmSeverity
    ),
    ConsoleState("alarms-all", "acknowledge-all", alarmed(*AlarmCause), panel("fleet", "alarms-all")),
    ConsoleState("alarms-folded", "alarms-fold", alarmed(*AlarmCause), folded),
    ConsoleState("alarms-ended", "alarms", ended),
    # vehicles
    ConsoleState("table", "fleet-table", mixed, panel("fleet", "sort-battery"), count=len(Phase)),
    ConsoleState("no-match", "filter-problem", mixed, filled(panel("fleet"), filter="battery<<")),
    ConsoleState("grid", "fleet-grid", mixed, panel("fleet", "fleet-view"), count=1000),
    ConsoleState("selection", "selection", mixed, some_selected, count=len(Phase)),
    ConsoleState("group", "group-page", mixed, group_page),
    *(
        ConsoleState(f"vehicle-{phase}", "vehicle-id", flown(ShowPhase.RUNNING, phase), vehicle_page)
        for phase in (Phase.FORMATION, Phase.PILOT, Phase.LOST, Phase.KILLED)
    ),
    # panels and sheets
    ConsoleState(
        "shape", "shape", running, filled(panel("shape"), formation__radius_m="12", target__x_m="far")
    ),
    ConsoleState("obstacles", "obstacle-tower", obstacles, panel("obstacles", "obstacle-remove-tower")),
    ConsoleState("obstacle-new", "obstacle-id", act=panel("obstacles", "obstacle-add")),
    ConsoleState("obstacle-changed", "obstacle-save", obstacles, panel("obstacles", "obstacle-change-van")),
    ConsoleState("obstacle-drawn", "preview", obstacles, obstacle_previewed),
    ConsoleState("shows", "show-broken", act=bad_show),
    ConsoleState("show-outdated", "show-outdated", night_selected, previewed),
    ConsoleState("drawn", "drawn", act=previewed),
    ConsoleState("placing", "placing", act=placed),
    ConsoleState("site", "site-edit", with_site, panel("feature-site")),
    ConsoleState("site-edited", "site-editor", with_site, site_edited),
    ConsoleState("site-refused", "site-problems", with_site, site_refused),
    *(
        ConsoleState(f"events-{chosen}", f"events-{chosen}", happened, panel("events", f"events-{chosen}"))
        for chosen in ("lines", "commands", "refused")
    ),
    ConsoleState("plots", "panel-plots", running, panel("plots")),
    ConsoleState("stations", "lead-cancel", station_lost, panel("stations", "lead-take"), stations=SITE),
    ConsoleState("help", "sheet-help", act=keyed("?", "sheet-help")),
    ConsoleState("kill", "kill-arm", mixed, keyed("Shift+K", "kill-arm", "kill-pick-d2"), count=len(Phase)),
    ConsoleState(
        "kill-armed", "kill-hold", running, keyed("Shift+K", "kill-arm", "kill-who-all", "kill-arm")
    ),
    ConsoleState("answers", "toast-refused", running, refused),
    ConsoleState("replay", "mark-error", replayed, life="Replay"),
    ConsoleState("report", "report-read", replayed, panel("report"), life="Replay"),
)


@contextmanager
def served(state: ConsoleState, folder: Path) -> Iterator[tuple[FakeService, str, str]]:
    """A service in that state, its address, and a token for its role."""
    service = FakeService(state.count, folder / "shows", state.stations)
    state.prepare(service)
    authorization, token = None, ""
    if state.role is not None:
        file = folder / "tokens.json"
        token = create_token(file, f"the-{state.role}", state.role)
        authorization = Authorization(Tokens(file))
    with in_background(Ticking(service, authorization)) as port:
        yield service, f"http://127.0.0.1:{port}", token


@contextmanager
def in_state(chrome: Browser, state: ConsoleState, folder: Path, size: tuple[int, int]) -> Iterator[Console]:
    """The page of a service in that state."""
    with ExitStack() as server:
        service, url, token = server.enter_context(served(state, folder))
        with console(chrome, url, width=size[0], height=size[1]) as ui:
            if state.role is not None and not state.name.startswith("login"):
                entered(token)(ui)
            if state.life in {"No connection", "Control stopped"}:
                ui.says("connection", "Live")
                if state.life == "Control stopped":
                    service.stands_still = True
                else:
                    server.close()
            ui.says("connection", state.life)
            state.act(ui)
            expect(ui.part(state.shown).first).to_be_visible(timeout=SOON_MS)
            yield ui
