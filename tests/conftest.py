"""Separates tests that depend on the real clock from those that only compute."""

import gc
import logging
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants

from gcs.api.schemas import convert
from gcs.service import check_process
from tests.support import netns
from tests.support.browsers import GET_ONE, NOT_RUN, REQUIRED, chromium, is_required
from tests.support.forks import Forks
from tests.support.machine import restrict_at_usual_priority

gc.disable()  # until collection ends: a quarter of its time

# The same examples in every run, and no clock that a busy machine would fail.
# `make soak` takes 1,000, `make test` 20.
for profile, examples in (("machine", 20), ("soak", 1000)):
    settings.register_profile(
        profile,
        max_examples=examples,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow],
    )
settings.load_profile("machine")

# By itself Hypothesis also draws the numbers and texts of every module of ours that is imported so far: the
# examples would depend on which other tests are collected, and change with every commit.
providers._get_local_constants = Constants

HERE = Path(__file__).parent
BROWSER = HERE / "browser"
SEVERAL_HOSTS = (HERE / "system" / "test_site_hosts.py", HERE / "system" / "test_site_standby_hosts.py")
BY_THE_CLOCK = (HERE / "unit" / "api", HERE / "unit" / "recording")  # a state's age; threads that write soon
NOT_COMPUTED = (BROWSER, HERE / "integration", *BY_THE_CLOCK)  # `make computed` does not collect them
ALL_SOAK = "\npytestmark = pytest.mark.soak\n"
REAL_TIME = (*NOT_COMPUTED, HERE / "system")

# Made once before `--forks` copies the process, where several files need it: 2 s of a processor for each.
ONCE = {"gcs.testing.virtual_show": "load_machine_code", "tests.support.written_show": "check_once"}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--forks", type=int, default=0, help="collect once, run in so many copies")
    parser.addoption("--again", action="store_true", help="only tests that the cache names as failed")


def pytest_configure(config: pytest.Config) -> None:
    if forks := config.getoption("forks"):
        config.pluginmanager.register(Forks(forks), "forks")
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for `make test &`
    if is_required() and chromium() is None:
        raise pytest.UsageError(f"{REQUIRED} is set, and there is no Chromium: {GET_ONE}")
    if netns.is_required() and not netns.are_possible():
        raise pytest.UsageError(f"{netns.REQUIRED} is set, and there are none: {netns.GET_THEM}")
    config.addinivalue_line(
        "markers", "netns: needs network namespaces, and is deselected where there are none"
    )
    config.addinivalue_line(
        "markers", "soak: shown by endurance only; run by `make soak`, and no part of `make test`"
    )
    config.addinivalue_line(
        "markers", "alternates(start): every second combination of the parameters is run by `make soak` only"
    )
    config.addinivalue_line(
        "markers",
        "keeps(*names): all but these tests or combinations of parameters are run by `make soak` only",
    )
    config.addinivalue_line("markers", "long: a unit test of more than a second, and no part of `make quick`")
    config.addinivalue_line("markers", "computes: not a real-time test, whatever its folder")
    config.addinivalue_line(
        "markers",
        "realtime: keeps time with the real clock; what computes beside it takes only what it leaves over",
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """What `make soak` alone runs is not even imported by `make test`."""
    if collection_path.suffix != ".py" or "not soak" not in config.option.markexpr:
        return None
    return True if ALL_SOAK in collection_path.read_text(encoding="utf-8") else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    _deselect(config, items)
    by_name = config.getoption("again") or any("::" in asked for asked in config.args)
    _move_to_soak(items, checks_names=not by_name)
    for item in items:
        computes = item.get_closest_marker("computes") is not None
        if computes and _is_in(NOT_COMPUTED, item.path):
            raise pytest.UsageError(f"{item.nodeid}: `make computed` does not collect its folder")
        if _is_in(REAL_TIME, item.path) and not computes:
            item.add_marker(pytest.mark.realtime)
        elif item.get_closest_marker("realtime"):
            folders = ", ".join(str(each.relative_to(HERE)) for each in REAL_TIME)
            raise pytest.UsageError(f"{item.nodeid}: what keeps time is in {folders} of tests")


def _deselect(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what this machine cannot run, and with `--again` what has not failed."""
    if chromium() is None:
        unseen = [item for item in items if BROWSER in item.path.parents]
        config.hook.pytest_deselected(items=unseen)
        items[:] = [item for item in items if BROWSER not in item.path.parents]
    if not netns.are_possible():
        alone = [item for item in items if item.get_closest_marker("netns")]
        config.hook.pytest_deselected(items=alone)
        items[:] = [item for item in items if not item.get_closest_marker("netns")]
    if config.getoption("again"):
        # Not pytest's --last-failed: it finds no id of schemathesis, and then runs everything.
        assert config.cache is not None
        failed = config.cache.get("cache/lastfailed", {})
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in failed])
        items[:] = [item for item in items if item.nodeid in failed]


def _move_to_soak(items: list[pytest.Item], *, checks_names: bool) -> None:
    """Mark what `alternates` and `keeps` leave to `make soak`.

    Raises: UsageError with `checks_names`, where a test that is kept does not exist.
    """
    unknown: set[tuple[Path, str]] = set()
    known: set[tuple[Path, str]] = set()
    combinations: Counter[tuple[Path, str]] = Counter()
    for item in items:
        alternates = item.get_closest_marker("alternates")
        if alternates is not None:
            assert isinstance(item, pytest.Function)
            turn = combinations[item.path, item.originalname]
            combinations[item.path, item.originalname] += 1
            if (turn + alternates.args[0]) % 2:
                item.add_marker(pytest.mark.soak)
        for keeps in item.iter_markers("keeps"):
            assert isinstance(item, pytest.Function)
            names = {item.name, item.originalname, item.name.partition("[")[2].removesuffix("]")}
            unknown |= {(item.path, kept) for kept in keeps.args}
            known |= {(item.path, name) for name in names}
            if names.isdisjoint(keeps.args):
                item.add_marker(pytest.mark.soak)
    if checks_names and not unknown <= known:
        raise pytest.UsageError(f"marker keeps: there are no tests {sorted(unknown - known)}")


def _keeps_time(item: pytest.Item) -> bool:
    return item.get_closest_marker("realtime") is not None


@cache
def _is_in(folders: tuple[Path, ...], module: Path) -> bool:
    return any(folder in module.parents for folder in folders)


def _importers(items: list[pytest.Item], module: str) -> int:
    """The number of collected files that import that module, or a function or class of it."""
    collected = {item.path: item.module for item in items if isinstance(item, pytest.Function)}
    return sum(
        any(
            module in (getattr(value, "__module__", ""), getattr(value, "__name__", ""))
            for value in vars(each).values()
        )
        for each in collected.values()
    )


def pytest_collection_finish(session: pytest.Session) -> None:
    """The garbage collector skips what collection made: these objects live as long as the process."""
    gc.freeze()
    gc.enable()
    forks = session.config.pluginmanager.getplugin("forks")
    if forks is None:
        return
    if not any(map(_keeps_time, session.items)):
        for module, work in ONCE.items():
            if _importers(session.items, module) > 1:
                forks.prepare(getattr(sys.modules[module], work))
    elif "tests.support.started" in sys.modules:
        forks.prepare(
            sys.modules["tests.support.started"].loaded
        )  # one for all workers: 3 s of a processor each


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    asked = [Path(each.partition("::")[0]).resolve() for each in config.args]
    if chromium() is None and any(
        each == BROWSER or BROWSER in each.parents or each in BROWSER.parents for each in asked
    ):
        terminalreporter.write_line(NOT_RUN, yellow=True)
    if not netns.are_possible() and any(
        each in (module, *module.parents) for each in asked for module in SEVERAL_HOSTS
    ):
        terminalreporter.write_line(netns.NOT_RUN, yellow=True)
    if config.getoption("again"):
        for report in terminalreporter.getreports("passed"):
            if report.when == "call":
                line = f"FLAKY {report.nodeid}: failed once, passed by itself; a defect to be looked at"
                terminalreporter.write_line(line, yellow=True)


@pytest.fixture(params=["mavsdk", "native"])
def transport(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test holds for both transports: changes what `link_bench.a_link` makes."""
    monkeypatch.setattr("tests.support.link_bench.chosen", request.param)


@pytest.fixture
def prompt_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks of shows and reading of drawings run at the usual priority."""
    monkeypatch.setattr(check_process, "restrict", restrict_at_usual_priority)


@pytest.fixture
def patient_api(monkeypatch: pytest.MonkeyPatch) -> None:
    """The API takes a state for new that is 60 s old: a pause of the machine does not stop control."""
    monkeypatch.setattr(convert, "VIEW_AGE_MAX_S", 60.0)


@pytest.fixture(autouse=True)
def _patient(request: pytest.FixtureRequest) -> None:
    """All tests of the API without a socket are patient; a module whose subject is the age says otherwise."""
    if HERE / "unit" / "api" in request.path.parents:
        request.getfixturevalue("patient_api")


@pytest.fixture
def logging_restored() -> Iterator[None]:
    """For tests of commands that set up logging: the process is the tests' own."""
    root = logging.getLogger()
    kept = (
        root.handlers[:],
        root.level,
        {name: logging.getLogger(name).level for name in ("gcs", "api", "sim")},
    )
    yield
    root.handlers[:], level, levels = kept
    root.setLevel(level)
    for name, each in levels.items():
        logging.getLogger(name).setLevel(each)
