"""How the tests judge one mutant: in a worker's own copy, in a process that has everything else loaded."""

import gc
import importlib
import multiprocessing
import os
import resource
import shutil
import signal
import sys
from pathlib import Path

from cosmic_ray.mutating import use_mutation
from cosmic_ray.plugins import get_operator

from tests.mutate.mutants import Change, Mutant, change

COPIED = ("gcs", "sim", "api", "configs", "tests", "pyproject.toml")

QUICK, THOROUGH = "tests/unit/safety/test_safety_*.py", "tests/properties/test_filter_*.py"
"""First what computes by hand, then, for what that lets pass, what always holds."""

OWN = ("neighbours", "traffic")
"""Modules whose properties say nothing of others."""

APART = ("traffic",)
"""Modules of which the properties of others say nothing: no other part of the filter calls them."""

WORK_AT_MOST_S = {QUICK: 5, THOROUGH: 30}
"""Several times what the tests cost, and all of it where a loop does not end any more. It is the processor's
time: on a busy machine nothing is killed for being slow.
"""

CROWDED = "test_safety_strays"
"""Flies crowds, which takes minutes where nothing is compiled."""

EXAMPLES = 30
"""Of each property, the same ones for every mutant."""

LOADED = ("numba", "pytest", "hypothesis.extra.numpy", "gcs.formation.steering", "gcs.model.plan")
"""Before a worker divides: nothing of `gcs.safety`, which every test process loads as it is broken then."""

LOG = Path("tests.log")


def copy(source: Path, target: Path) -> None:
    """What the tests need, without what was compiled from it."""
    target.mkdir()
    for name in COPIED:
        if (source / name).is_dir():
            shutil.copytree(
                source / name, target / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
            )
        else:
            shutil.copy(source / name, target / name)


def begin(snapshot: Path) -> None:
    """A worker's beginning: in a copy of its own; an interruption waits until it has mended that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    own = snapshot.with_name(f"worker-{os.getpid()}")
    copy(snapshot, own)
    os.chdir(own)
    sys.path.insert(0, str(own))
    sys.dont_write_bytecode = True  # two mutants of one second would be taken for the same
    os.environ.update(NUMBA_DISABLE_JIT="1", OPENBLAS_NUM_THREADS="1", PYTEST_DISABLE_PLUGIN_AUTOLOAD="1")
    for name in LOADED:
        importlib.import_module(name)
    gc.freeze()  # pytest collects garbage twice a session: not what is shared


def judge(mutant: Mutant) -> Change | None:
    """Break the module, run the tests, mend it.

    Returns: what survived, None where a test failed.
    """
    operator, path = get_operator(mutant.operator)(), Path(mutant.file)
    with use_mutation(path, operator, mutant.occurrence) as (was, becomes):
        return None if complaint(path.stem) else change(mutant, was, becomes)


def complaint(module: str = "") -> str:
    """What the tests of a module, or of all, say of the code in the working directory; "" where they pass."""
    for pattern, at_most_s in WORK_AT_MOST_S.items():
        paths = [str(path) for path in sorted(Path().glob(pattern)) if _concerns(path.stem, module)]
        tests = multiprocessing.get_context("fork").Process(target=_run_tests, args=(paths, at_most_s))
        tests.start()
        tests.join()
        if tests.exitcode != 0:
            return LOG.read_text(encoding="utf-8") or f"ended with {tests.exitcode}"
    return ""


def _concerns(test: str, module: str) -> bool:
    """Whether what fails there can tell that this module is broken."""
    if test == CROWDED or not module or not test.startswith("test_filter_"):
        return test != CROWDED
    subject = test.removeprefix("test_filter_")
    return subject == module or (subject not in OWN and module not in APART)


def _run_tests(paths: list[str], at_most_s: int) -> None:
    """Ends as pytest does. What it says goes into the log."""
    hypothesis, pytest = importlib.import_module("hypothesis"), importlib.import_module("pytest")
    resource.setrlimit(resource.RLIMIT_CPU, (at_most_s, at_most_s))
    log = os.open(LOG, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, sys.stdout.fileno())
    os.dup2(log, sys.stderr.fileno())
    without_shrinking = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
    hypothesis.settings.register_profile("mutate", max_examples=EXAMPLES, phases=without_shrinking)
    hypothesis.settings.load_profile("mutate")
    for name in [name for name in sys.modules if name.partition(".")[0] == "tests"]:
        del sys.modules[name]  # the checkout's; the worker's copy has its own
    plainly = ("-x", "-q", "--assert=plain", "--tb=short", "-p", "no:cacheprovider", "-p", "pytest_timeout")
    code = int(pytest.main([*plainly, "-o", "addopts=--strict-markers --import-mode=importlib", *paths]))
    sys.stdout.flush()
    os._exit(code)  # without taking down, object by object, what all of them share
