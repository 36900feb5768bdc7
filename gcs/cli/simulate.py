"""`gcs simulate` and `gcs show`: fly scenarios and show files in virtual time, judge, draw and hash them."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pydantic import ValidationError

from gcs.cli.output import MOVING, PICTURES, answer, note, output_file, print_json, require_matplotlib
from gcs.cli.progress import share_of
from gcs.cli.shows.drawn_shows import rules_of
from gcs.config import schema
from gcs.config.schema import Config
from gcs.config.setting_errors import explained
from gcs.formation.laws.registry import allow_code
from gcs.model.errors import ConfigError, ShowError
from gcs.model.jit import is_compiled
from gcs.shows import LoadedShow, find, load
from gcs.shows.area_checks import area_flaws
from gcs.shows.drawn_checks import examine
from gcs.shows.loading import service_flaws
from gcs.shows.service_rules import ServiceRules
from gcs.simulation import scenario as scenarios
from gcs.simulation.batch import Run, judged_runs, passed, run_once, summary
from gcs.simulation.cores import on_all_cores
from gcs.simulation.flight import prepared
from gcs.simulation.rehearsal import rehearse
from gcs.simulation.scenario import Adversity, Scenario, ShowFlight
from gcs.simulation.verdict import judge, table
from gcs.site.simulated import SimulatedStations


def run_simulate(arguments: argparse.Namespace) -> int:
    """Fly the scenarios. Returns: 0 when the runs meet their scenarios' limits, 1 otherwise."""
    allow_code(Path.cwd())
    runs = [run for scenario in _scenarios(arguments) for run in _runs(scenario, arguments)]
    if arguments.plot is not None:
        return _plot_scenario(runs, arguments)
    _note_compilation(arguments)
    if len(runs) == 1:
        return _run_one(runs[0], arguments)
    reports = []
    for figures in on_all_cores(run_once, runs, arguments.workers, progress=not arguments.json):
        reports.append(figures)
        if arguments.json:
            print_json(figures, indent=None)
    if not arguments.json:
        print(summary(reports))
    return 0 if passed(reports) else 1


def _note_compilation(arguments: argparse.Namespace) -> None:
    """Say why the first flight after an installation begins late."""
    if not is_compiled():
        text = "compiling the law first, for a minute or two; later flights begin at once"
        note(text, as_json=arguments.json)


def _run_one(run: Run, arguments: argparse.Namespace) -> int:
    """Fly one, and show how far it is. Returns: as `run_simulate`."""
    with share_of(f"flying {run.scenario.name} in virtual time", shown=not arguments.json) as report:
        figures = run_once(run, report)
    answer(arguments, figures, summary([figures]), indent=None)
    return 0 if passed([figures]) else 1


def _scenarios(arguments: argparse.Namespace) -> list[Scenario]:
    if sum(map(bool, (arguments.all, arguments.row, arguments.scenario))) > 1:
        raise ConfigError("--all, --row or scenarios by name: one of them")
    if arguments.all:
        return list(map(scenarios.load, scenarios.shipped()))
    if arguments.row:
        return [each for each in map(scenarios.load, scenarios.shipped()) if each.row == arguments.row]
    if not arguments.scenario:
        known = ", ".join(path.stem for path in scenarios.shipped())
        raise ConfigError(f"name a scenario, or --all; there are: {known}")
    return [Scenario.load(name) for name in arguments.scenario]


def _runs(scenario: Scenario, arguments: argparse.Namespace) -> list[Run]:
    if arguments.law is not None:
        scenario = scenario.with_(law=arguments.law)
    if arguments.seed is not None and arguments.seeds is not None:
        raise ConfigError("--seed or --seeds, not both")
    if arguments.all or arguments.row or arguments.judged:
        judged = judged_runs(scenario, SimulatedStations)
        judged = [run for run in judged if arguments.vehicles in (None, run.vehicles)]
        desired = None if arguments.seeds is None else set(arguments.seeds)
        return [run for run in judged if desired is None or run.seed in desired]
    seeds: Sequence[int] = arguments.seeds or [1 if arguments.seed is None else arguments.seed]
    return [Run(scenario, arguments.vehicles, seed, SimulatedStations) for seed in seeds]


def _plot_scenario(runs: list[Run], arguments: argparse.Namespace) -> int:
    require_matplotlib("--plot")
    from gcs.simulation.animation import animate  # noqa: PLC0415  (takes a second, only for plots)
    from gcs.simulation.plot import draw  # noqa: PLC0415

    if len(runs) != 1:
        raise ConfigError(f"--plot draws one flight: one scenario and one seed, not {len(runs)}")
    if isinstance(runs[0].scenario.flight, ShowFlight):
        raise ConfigError(f"{runs[0].scenario.name}: it flies a show: gcs show plot draws one")
    file = output_file(arguments.plot, (*PICTURES, MOVING), "--plot ")
    _note_compilation(arguments)
    record = prepared(runs[0].scenario, runs[0].vehicles, runs[0].seed, runs[0].divide).fly()
    figures = (animate if file.suffix.lower() == MOVING else draw)(record, file)
    answer(arguments, figures, summary([figures | {"failed": [], "missed": []}]), indent=None)
    return 0


def hash_show(arguments: argparse.Namespace) -> int:
    """Print the hash of a show. Returns: 0. Raises: ConfigError for a bad file."""
    digest = load(find(arguments.file)).show.digest
    answer(arguments, {"hash": digest}, digest)
    return 0


def check_show(arguments: argparse.Namespace) -> int:
    """Fly a show, and judge it. Returns: 0; 1 when it fails. Raises: ConfigError for no such file."""
    path = find(arguments.file)
    try:
        loaded = load(path)
        config = None if arguments.config is None else schema.load(schema.find(arguments.config))
        rules = rules_of(arguments)
        _examine(loaded, rules, config)
    except ShowError as error:
        if arguments.json:
            problems = [asdict(problem) for problem in error.problems]
            print_json({"show": path.stem, "file": error.file, "good": False, "problems": problems})
        else:
            print(error, file=sys.stderr)
        return 1
    _note_compilation(arguments)
    with share_of(f"flying {path.stem} in virtual time", shown=not arguments.json) as report:
        adversity, wind_m_s = _adversity(arguments)
        verdict = judge(rehearse(loaded, arguments.seed, report, adversity, wind_m_s, rules))
    model = {"model": loaded.show.model_dump(mode="json")} if arguments.model else {}
    answer(arguments, asdict(verdict) | model, table(verdict), indent=None)
    return 0 if verdict.good else 1


def _adversity(arguments: argparse.Namespace) -> tuple[Adversity, tuple[float, float]]:
    """Return what the show is rehearsed with that it does not know of, and the wind. Raises: ConfigError."""
    boxes = [
        {"x_m": x, "y_m": y, "half_length_x_m": half_x, "half_length_y_m": half_y, "height_m": height}
        for x, y, half_x, half_y, height in arguments.box or ()
    ]
    loss = {"share": arguments.lost or 0.0, "at_s": arguments.lost_at, "action": arguments.when_lost}
    try:
        adversity = Adversity.model_validate({"loss": loss, "boxes": boxes})
    except ValidationError as error:
        raise explained(error, "the rehearsal", Adversity, None) from None
    return adversity, arguments.wind or (0.0, 0.0)


def _examine(loaded: LoadedShow, rules: ServiceRules | None, config: Config | None) -> None:
    """Look at drawn parts, and at what a service allows, before the flight. Raises: ShowError."""
    flaws = [] if loaded.drawing is None else examine(loaded.timeline)[1]
    if config is not None:
        flaws += service_flaws(loaded.show, config.frame, config.control, config.operation, len(config.fleet))
    if rules is not None:
        flaws += area_flaws(loaded.timeline, rules)
    if flaws:
        raise ShowError(loaded.file, [loaded.problem(flaw) for flaw in flaws])


def plot_show(arguments: argparse.Namespace) -> int:
    """Draw a show as it flies. Returns: 0; 1 when it fails its check. Raises: ConfigError for a bad file."""
    loaded = load(find(arguments.file))
    require_matplotlib("gcs show plot")
    from gcs.simulation.plot import draw_show  # noqa: PLC0415  (takes a second, only for plots)

    file = output_file(arguments.picture, PICTURES, "")
    _note_compilation(arguments)
    with share_of("flying it in virtual time", shown=not arguments.json) as report:
        verdict = draw_show(rehearse(loaded, arguments.seed, report), file)
    answer(arguments, {"picture": str(file), "good": verdict.good}, "")
    return 0 if verdict.good else 1
