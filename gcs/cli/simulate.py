"""`gcs simulate`: flies scenarios in virtual time and judges them."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from gcs.cli.output import print_json
from gcs.cli.plots import require_matplotlib
from gcs.cli.progress import working
from gcs.model.errors import ConfigError
from gcs.simulation import scenario as scenarios
from gcs.simulation.batch import Run, judged_runs, passed, run_all
from gcs.simulation.flight import fly
from gcs.simulation.summary import summary


def run(arguments: argparse.Namespace) -> int:
    """Fly the scenarios. Returns: 0 when the runs meet their scenarios' limits, 1 otherwise."""
    paths = _paths(arguments)
    if arguments.plot is not None:
        return _plot(paths, arguments)
    runs = [run for path in paths for run in _runs(path, arguments)]
    reports = []
    text = f"flying {len(runs)} in virtual time" if len(runs) > 1 else "flying"
    with working(text, len(runs), shown=not arguments.json) as one_done:
        for figures in run_all(runs, arguments.workers):
            reports.append(figures)
            one_done()
            if arguments.json:
                print_json(figures, indent=None)
    if not arguments.json:
        print(summary(reports))
    return 0 if passed(reports) else 1


def _paths(arguments: argparse.Namespace) -> list[Path]:
    if sum(map(bool, (arguments.all, arguments.row, arguments.scenario))) > 1:
        raise ConfigError("--all, --row or scenarios by name: one of them")
    if arguments.all:
        return scenarios.shipped()
    if arguments.row:
        return [path for path in scenarios.shipped() if scenarios.load(path).row == arguments.row]
    if not arguments.scenario:
        known = ", ".join(path.stem for path in scenarios.shipped())
        raise ConfigError(f"name a scenario, or --all; there are: {known}")
    return [scenarios.find(name) for name in arguments.scenario]


def _runs(path: Path, arguments: argparse.Namespace) -> list[Run]:
    scenario = scenarios.load(path)
    if arguments.seed is not None and arguments.seeds is not None:
        raise ConfigError("--seed or --seeds, not both")
    judged = judged_runs(path, scenario)
    if arguments.all or arguments.row or arguments.judged:
        judged = [run for run in judged if arguments.vehicles in (None, run.vehicles)]
        desired = None if arguments.seeds is None else set(arguments.seeds)
        return [run for run in judged if desired is None or run.seed in desired]
    seeds: Sequence[int] = arguments.seeds or [1 if arguments.seed is None else arguments.seed]
    vehicles = scenario.judged.vehicles[0] if arguments.vehicles is None else arguments.vehicles
    if vehicles < 1:
        raise ConfigError(f"--vehicles {vehicles}: at least 1")
    return [Run(path, vehicles, seed) for seed in seeds]


def _plot(paths: list[Path], arguments: argparse.Namespace) -> int:
    require_matplotlib("--plot")
    from gcs.simulation.plot import draw  # noqa: PLC0415  (takes a second, only for plots)

    runs = [run for path in paths for run in _runs(path, arguments)]
    if len(runs) != 1:
        raise ConfigError(f"--plot draws one flight: one scenario and one seed, not {len(runs)}")
    file = Path(arguments.plot)
    if not file.parent.is_dir() or file.suffix not in {".png", ".svg", ".pdf"}:
        raise ConfigError(f"--plot {file}: a .png, .svg or .pdf file in a folder that exists")
    figures = draw(fly(scenarios.load(paths[0]), runs[0].vehicles, runs[0].seed), file)
    if arguments.json:
        print_json(figures, indent=None)
    else:
        print(summary([figures | {"failed": [], "missed": []}]))
    return 0
