"""`gcs demo`: fake fleet, service and API on one machine, and a scripted demonstration flight."""

import argparse
import asyncio
import logging
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from itertools import cycle
from math import ceil, hypot, sqrt
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np

from gcs.cli.demo import demo_report as report
from gcs.cli.demo import demo_script, demo_show, demo_site, demo_target
from gcs.cli.demo.demo_script import DemoScript, Marks, Scale, StoppedEarlyError
from gcs.cli.demo.demo_show import ShowScript
from gcs.cli.output import REFUSED, Say, answer, failed, lines
from gcs.cli.service.memory import save_memory
from gcs.cli.service.process import ignore_the_terminal, run_exactly, set_up_log
from gcs.cli.service.serve import StationService, running
from gcs.cli.service.supervisor import hangs_up
from gcs.client import Client
from gcs.config import schema as configuration
from gcs.config.sections import LinkSettings
from gcs.config.site import station_config
from gcs.control import warm_up
from gcs.estimation.positioning import uncertainty_m
from gcs.formation.laws.protocol import GoalShape
from gcs.formation.laws.registry import allow_code, law_of, place_of
from gcs.links.autopilots import AUTOPILOTS, DEFAULT
from gcs.links.settings import SYSTEM_ID_MAX
from gcs.model.errors import ConfigError, GcsError
from gcs.model.plan import DEFAULT_LAW
from gcs.model.state import Array
from gcs.planning.feasibility import smallest_formation_radius_m
from gcs.preflight.parameters import settings_of
from gcs.shows import LoadedShow
from gcs.sim.cli import parameter_options
from gcs.sim.settings import PAD_SPACING_M
from gcs.sim.vehicle.sensors import IDEAL_RECEIVER, SIH_RECEIVER

MIXED = "mixed"
"""Every autopilot in one fleet."""

MIXED_LOSS_S = 3.0
"""Some autopilots fly on for so long without setpoints, and cannot be set: then all do, and stop together."""

VEHICLES_MAX = {"mavsdk": 50, "native": 1000}
CHILD_ENDS_S = 5.0

SPHERE, LARGE_SPHERE = (1.2, 10.0), (1.05, 6.0)
"""Radius of the sphere relative to the smallest possible one, and height of its lowest point."""

LARGE_STAGGER_S = 0.02
"""Time between take-offs of hundreds of vehicles, which climb vertically."""
INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells."""


def run_demo(arguments: argparse.Namespace) -> int:
    """Fly. Returns: 0 when all landed, kept the floor and entered no obstacle; else nonzero."""
    save_memory()
    set_up_log(logging.INFO if arguments.verbose else logging.ERROR)
    config, loaded = make_config(arguments), demo_show.loaded_for(arguments)
    say = lines(arguments)
    say("getting_ready", "getting ready (the first time the law is compiled, for a minute or two)")
    warm_up()
    try:
        with tempfile.TemporaryDirectory(prefix="gcs-demo-") as temporary:
            folder = Path(arguments.truth or arguments.record or temporary)
            folder.mkdir(parents=True, exist_ok=True)
            figures = run_exactly(_fly(config, arguments, folder / "truth.jsonl", say, loaded))
    except StoppedEarlyError as stopped:
        say("interrupted", f"gcs demo: {stopped}; the fleet is down")
        return INTERRUPTED
    except GcsError as error:
        return failed(error, arguments, REFUSED)
    answer(arguments, figures, report.summary(figures), indent=None)
    good = figures["landed"] == arguments.vehicles and not figures["separation_violations"]
    follows = loaded is None or loaded.drawing is None or _follows(figures)
    if arguments.target is not None:
        follows = float(str(figures.get("target_p95_m", "inf"))) <= demo_target.P95_MAX_M
    return 0 if good and follows and not figures["obstacle_penetrations"] else 1


def _follows(figures: Mapping[str, object]) -> bool:
    rms_m = figures.get("track_rms_m")
    return isinstance(rms_m, float) and rms_m <= demo_show.TRACK_RMS_MAX_M


def make_config(arguments: argparse.Namespace) -> configuration.Config:
    """Adapt the shipped demo configuration to the arguments. Raises: ConfigError, InvalidError."""
    if arguments.stations != 1:
        _check_stations(arguments)
    count, most = arguments.vehicles, VEHICLES_MAX[arguments.transport] * arguments.stations
    if not 2 <= count <= most:
        advice = "" if count < 2 or arguments.transport == "native" else "; --transport native bears more"
        raise ConfigError(f"--vehicles {count}: 2 to {most} is possible{advice}")
    allow_code(Path.cwd())
    place_of(arguments.law or DEFAULT_LAW)
    raw = configuration.load(configuration.find("demo")).model_dump()
    large = arguments.transport == "native"
    if large:
        _make_large(raw, arguments)
    else:
        link = raw["links"][0]
        link["listen"] = f"udpin://127.0.0.1:{arguments.port_base}"
        link["ports"] = link["vehicles"]["count"] = count
    _set_autopilots(raw, _autopilot(arguments))
    if arguments.record is not None:
        raw["record"] = {"folder": arguments.record}
    if arguments.api_port is not None:
        raw["api"]["port"] = arguments.api_port
    if (loaded := demo_show.loaded_for(arguments)) is not None:
        demo_show.fit(raw, loaded)
    demo_target.fit(raw, arguments.target, arguments.tak)
    base = configuration.Config.model_validate(raw)
    spare, lowest_m = LARGE_SPHERE if large else SPHERE
    least_m = smallest_formation_radius_m(count, base.control.safety, _uncertainty_m(base, arguments))
    radius_m = max(base.formation.radius_m, least_m * spare)
    raw["formation"] = {
        "radius_m": radius_m,
        "height_m": radius_m + lowest_m,
        "law": arguments.law or DEFAULT_LAW,
    }
    fence = raw["control"]["safety"]["fence"]
    fence["height_max_m"] = max(fence["height_max_m"], 2.0 * radius_m + 30.0)
    config = configuration.Config.model_validate(raw)
    scale = _scale(config)
    needed_s = scale.shortest_s if large else scale.whole_s
    if loaded is None and arguments.seconds is not None and arguments.seconds < needed_s:
        raise ConfigError(f"--seconds {arguments.seconds:g}: at least {needed_s:g} for {count} vehicles")
    if arguments.stations == 1:
        return config
    raw = config.model_dump()
    demo_site.add_stations(raw, arguments.stations)
    return configuration.Config.model_validate(raw)


def _check_stations(arguments: argparse.Namespace) -> None:
    """Raises: ConfigError for stations that cannot share the fleet, or its law."""
    count, vehicles = arguments.stations, arguments.vehicles
    if not 2 <= count <= demo_site.STATIONS_MAX:
        raise ConfigError(f"--stations {count}: 1 to {demo_site.STATIONS_MAX} is possible")
    if ":" in (arguments.law or ""):
        text = "a file's law flies with one station; several need its package installed"
        raise ConfigError(f"--law {arguments.law}: {text}")
    if arguments.transport != "native":
        arguments.transport = "native"
    if ceil(vehicles / ceil(vehicles / count)) != count or ceil(vehicles / count) > SYSTEM_ID_MAX:
        text = f"--stations {count}: {vehicles} vehicles are no equal shares of up to {SYSTEM_ID_MAX}"
        raise ConfigError(text)


def _scale(config: configuration.Config) -> Scale:
    formation, stagger_s = config.formation, config.operation.takeoff_stagger_s
    count, top_m = len(config.ids), formation.radius_m + formation.height_m
    large = config.links[0].transport == "native"
    field_m = hypot(*[(_columns(count) - 1) * PAD_SPACING_M / 2.0] * 2) if large else 0.0
    return Scale(count, stagger_s, formation.radius_m, top_m, field_m)


def _make_large(raw: dict[str, Any], arguments: argparse.Namespace) -> None:
    """Configure native links, all with the same system ids, and a sphere over the field's centre."""
    counts = _namespaces(arguments.vehicles, arguments.stations)
    raw["links"] = [
        {
            "name": name,
            "transport": "native",
            "listen": f"udpin://127.0.0.1:{arguments.port_base + index}",
            "vehicles": {"count": count, "id_pattern": "{link}{system_id}"},
            "streams": {"state_hz": 2.0},
        }
        for index, (name, count) in enumerate(zip(ascii_lowercase, counts, strict=False))
    ]
    field_m = (_columns(arguments.vehicles) - 1) * PAD_SPACING_M
    raw["target"] = {"x_m": field_m / 2.0, "y_m": field_m / 2.0}
    raw["operation"]["pads_within_m"] = max(50.0, 1.5 * field_m)
    raw["operation"]["takeoff_stagger_s"] = LARGE_STAGGER_S * arguments.stations  # of each station


def _autopilot(arguments: argparse.Namespace) -> str:
    """The autopilot of the fleet, or MIXED. Raises: ConfigError."""
    named: str = arguments.autopilot or DEFAULT.name
    if named not in (known := (*AUTOPILOTS, MIXED)):
        raise ConfigError(f"--autopilot {named}: one of {', '.join(known)}")
    return named


def _set_autopilots(raw: dict[str, Any], named: str) -> None:
    """Configure vehicles of that autopilot; MIXED: of each in turn, over all links, as the fake fleet."""
    if named != MIXED:
        raw["links"] = [{**link, "autopilot": named} for link in raw["links"]]
        return
    kinds = cycle(AUTOPILOTS)
    for link in raw["links"]:
        fleet = LinkSettings.model_validate(link).fleet
        link["vehicles"] = [vehicle.model_dump() | {"autopilot": next(kinds)} for vehicle in fleet]
    raw["operation"]["setpoint_loss_s"] = MIXED_LOSS_S


def _uncertainty_m(config: configuration.Config, arguments: argparse.Namespace) -> Array:
    """(n,) Standard deviations that the service will count for the fake fleet's positions."""
    receiver, floor = IDEAL_RECEIVER if arguments.ideal else SIH_RECEIVER, config.control.safety.floor
    reported = receiver.horizontal_m, receiver.vertical_m, float(receiver.fix_type)
    level_m, up_m, fix = (np.full(arguments.vehicles, value) for value in reported)
    least = floor.uncertainty_m, floor.vertical_uncertainty
    return uncertainty_m(*least, level_m, up_m, fix, config.positioning)


def _columns(count: int) -> int:
    return ceil(sqrt(count))


def _namespaces(count: int, stations: int) -> list[int]:
    """Number of vehicles behind each port: the same for all ports except the last."""
    each = ceil(count / max(stations, ceil(count / SYSTEM_ID_MAX)))
    return [min(each, count - first) for first in range(0, count, each)]


async def _fly(
    config: configuration.Config,
    arguments: argparse.Namespace,
    truth: Path,
    say: Say,
    loaded: LoadedShow | None = None,
) -> dict[str, object]:
    began_s = time.monotonic()

    def describe(text: str, **facts: object) -> None:
        time_s = time.monotonic() - began_s
        line = text if arguments.json else f"[{time_s:6.1f} s] {text}"
        say("script", line, time_s=round(time_s, 3), **facts)

    several = bool(config.stations)
    own, site = (station_config(config, demo_site.NAMES[0]), config) if several else (config, None)
    alone: AbstractContextManager[dict[str, str]] = nullcontext({})
    target: AbstractContextManager[None] = nullcontext()
    target_truth = truth.with_name("target.jsonl")
    if arguments.target is not None:
        target = demo_target.fake_target(config, arguments.target, arguments.seed, target_truth)
    beside = demo_site.other_stations(config, truth.parent) if several else alone
    places = None if loaded is None else demo_show.grid_options(loaded)
    parts: list[int] = []
    with fake_fleet(config, arguments, truth, places), beside as others, target:
        async with running(own, site=site) as (service, port):
            url = f"http://{config.api.host}:{port}"
            describe(
                f"{arguments.vehicles} fake vehicles; look at them at {url}/ ; API at {url}/docs", url=url
            )
            rows: list[tuple[float, ...]] = []
            recorder = asyncio.create_task(_follow(service, rows), name="history")
            with Client(url) as client:
                scale = _scale(config)
                seconds = arguments.seconds or max(demo_script.DEFAULT_S, scale.whole_s)
                make = DemoScript if arguments.target is None else demo_target.TargetScript
                script: DemoScript | ShowScript = make(client, seconds, describe, scale)
                if loaded is not None:
                    script = ShowScript(client, loaded, describe)
                failure = await _fly_script(script)
            marks = script.marks
            if (run := service.player.show.run) is not None:
                parts = [run.parts.get(name, 0) for name in config.ids]
            recorder.cancel()
            tick_p99_ms = service.view.value.tick.duration_p99_ms or 0.0
            sent = service.view.value.setpoints_sent
            ticks_ms = await asyncio.to_thread(demo_site.tick_figures, others)
    if failure is not None:
        raise failure
    table = np.array(rows, dtype=np.float64)
    commanded = report.Commanded(table[:, 0], table[:, 1:4], table[:, 4], table[:, 5:7])
    law = config.formation.law if loaded is None else loaded.show.law
    figures = _judge(truth, commanded, marks, config, law_of(law).goal_shape)
    figures |= {"tick_p99_ms": round(tick_p99_ms, 3), "setpoints_sent": sent}
    if loaded is not None and loaded.drawing is not None:
        true = report.ground_truth(truth, config.frame, len(config.ids))
        figures |= demo_show.track_figures(true, loaded, table[:, [0, 7]], parts)
    if isinstance(script, demo_target.TargetScript):
        true = report.ground_truth(truth, config.frame, len(config.ids))
        figures |= demo_target.figures(true, target_truth, config, script)
    for name, p99_ms in ticks_ms.items():
        figures[f"tick_p99_ms_{name}"] = p99_ms
    return figures


async def _follow(service: StationService, rows: list[tuple[float, ...]]) -> None:
    """Record what the service commanded in every tick."""
    async for view in service.view.values():
        center_m = view.center_m or (np.nan, np.nan, np.nan)
        radius_m = np.nan if view.radius_m is None else view.radius_m
        clock_s = 0.0 if view.selected is None else view.selected.clock_s
        rows.append((view.time_s, *center_m, radius_m, *view.target_m, clock_s))


async def _fly_script(script: DemoScript | ShowScript) -> GcsError | None:
    """Run the script in a thread of its own; Ctrl-C and a closed terminal bring the fleet home.

    Returns: the error that ended it early; None when there was none.
    """
    for number in (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hangs_up() else [])):
        asyncio.get_running_loop().add_signal_handler(number, script.interrupt)
    ignore_the_terminal()
    try:
        await asyncio.to_thread(script.fly)
    except GcsError as failure:
        return failure
    return None


@contextmanager
def fake_fleet(
    config: configuration.Config,
    arguments: argparse.Namespace,
    truth: Path,
    places: Sequence[str] | None = None,
) -> Iterator[None]:
    """Run the fake fleet in one process of its own, which ends with the block.

    One process serves all vehicles: eight processes would take most of a core from the flight.
    """
    frame, count = config.show_frame, arguments.vehicles
    common = [sys.executable, "-m", "gcs.sim", "--port-base", str(arguments.port_base)]
    common += ["--origin", f"{frame.latitude_deg},{frame.longitude_deg},{frame.altitude_amsl_m}"]
    common += places or ["--grid-columns", str(_columns(count)), "--spacing", f"{PAD_SPACING_M:g}"]
    common += ["--seed", str(arguments.seed)]
    if arguments.ideal:
        common += ["--ideal"]
    if arguments.autopilot is not None:
        common += ["--autopilot", arguments.autopilot]
    if arguments.transport == "native":
        each = str(_namespaces(count, arguments.stations)[0])
        common += ["--shared-port", "--namespace-size", each, "--telemetry-hz", "10"]
    common += parameter_options(settings_of(config))
    common += ["--count", str(count), "--truth", str(truth)]
    # a session of its own: Ctrl-C must bring the fleet home, not kill the simulator in flight
    child = subprocess.Popen(common, stdout=subprocess.DEVNULL, start_new_session=True)  # noqa: S603
    try:
        yield
    finally:
        child.terminate()
        try:
            child.wait(CHILD_ENDS_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def _judge(
    truth_file: Path,
    commanded: report.Commanded,
    marks: Marks,
    config: configuration.Config,
    goal: GoalShape,
) -> dict[str, object]:
    truth = report.ground_truth(truth_file, config.frame, len(config.ids))
    smallest_m, violations = report.separation(truth, config.control.safety.floor)
    figures: dict[str, object] = {
        "vehicles": len(truth.landed_at_end),
        "landed": int(truth.landed_at_end.sum()),
        "min_separation_m": round(smallest_m, 3),
        "separation_violations": violations,
    }
    if goal is not GoalShape.SPHERE:
        figures["goal_shape"] = goal.value
    shapes = {
        name: report.shape(truth.between(*window), commanded, goal)
        for name, window in (("before", marks.before), ("after", marks.after))
        if window is not None
    }
    for name, worst in (("radius_error_m", max), ("energy_ratio", max), ("nearest_ratio", min)):
        values = {part: round(shape[name], 5) for part, shape in shapes.items() if name in shape}
        figures[name] = worst(values.values(), default=None)
        figures |= {f"{name}_{part}": value for part, value in values.items()}
    if marks.orbit is not None:
        error_m = report.orbit_error_m(truth.between(*marks.orbit), commanded, _scale(config).orbit_radius_m)
        figures["orbit_radius_error_m"] = round(error_m, 3)
    if marks.target_from_m and marks.target_to_m:
        moved_m = np.hypot(*np.subtract(marks.target_to_m, marks.target_from_m))
        figures["target_moved_m"] = round(float(moved_m), 1)
    inside = 0
    if marks.obstacle is not None and marks.obstacle_time_s is not None:
        inside = report.penetrations(truth.between(marks.obstacle_time_s, np.inf), marks.obstacle)
    figures["obstacle_penetrations"] = inside
    return figures
