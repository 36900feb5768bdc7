"""Compiled code on disk is never older than any of the kernels in it."""

import subprocess
import sys
from pathlib import Path

import pytest

from gcs.model import jit
from gcs.model.jit import digest_of, kept_beside

KERNEL = "from gcs.model.jit import kernel\n"
CALLER = KERNEL + "from callee import much\n\n@kernel\ndef asked(x):\n    return much(x)\n"
CALLEE = "from gcs.model.jit import kernel\n\n@kernel\ndef much(x):\n    return {factor} * x\n"


def forget() -> None:
    """Have sources read anew, as in another process."""
    for kept in (digest_of, jit._reached, jit._read, jit._own):
        kept.cache_clear()


def answer(folder: Path) -> float:
    """What the kernel in `folder` says in a process of its own, its code kept in a folder beside it."""
    script = (
        "import sys, pathlib; import gcs.model.jit as c;"
        f"folder = pathlib.Path({str(folder)!r}); sys.path.insert(0, str(folder));"
        "c.KEPT_IN = folder / 'kept';"
        "from caller import asked; print(asked(1.0))"
    )
    # -B: a file that is changed within a second keeps its size, and Python would take its old bytecode
    done = subprocess.run([sys.executable, "-B", "-c", script], capture_output=True, text=True, check=True)
    return float(done.stdout)


@pytest.mark.long
def test_change_in_a_called_kernel_recompiles_its_caller(tmp_path: Path) -> None:
    (tmp_path / "caller.py").write_text(CALLER)
    (tmp_path / "callee.py").write_text(CALLEE.format(factor=2.0))
    assert answer(tmp_path) == 2.0
    (tmp_path / "callee.py").write_text(CALLEE.format(factor=3.0))
    assert answer(tmp_path) == 3.0


def test_only_callers_are_compiled_again(tmp_path: Path) -> None:
    (tmp_path / "caller.py").write_text(CALLER)
    (tmp_path / "callee.py").write_text(CALLEE.format(factor=2.0))
    (tmp_path / "other.py").write_text(CALLEE.format(factor=2.0))
    names = ("caller.py", "callee.py", "other.py")
    before = [digest_of(tmp_path, tmp_path / name) for name in names]
    (tmp_path / "callee.py").write_text(CALLEE.format(factor=3.0))
    forget()
    after = [digest_of(tmp_path, tmp_path / name) for name in names]
    assert [a == b for a, b in zip(before, after, strict=True)] == [False, False, True]


def test_code_is_kept_beside_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    assert kept_beside(tmp_path).is_relative_to(tmp_path)


@pytest.mark.soak
@pytest.mark.long
def test_flight_needs_no_linear_algebra_of_scipy() -> None:
    script = (
        "import sys; from gcs.cli.service.memory import save_memory; save_memory();"
        "from gcs.control import warm_up; import gcs.flight.orchestrator; warm_up();"
        "print('scipy.linalg' in sys.modules);"
        "import scipy.linalg; print(scipy.linalg.cython_blas.__name__)"  # whoever wants it still has it
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "scipy.linalg.cython_blas"]


@pytest.mark.soak
@pytest.mark.long
def test_loaded_kernel_can_be_called_by_a_new_one(tmp_path: Path) -> None:
    """Its LLVM module was dropped when it was loaded, and is made again."""
    (tmp_path / "callee.py").write_text(CALLEE.format(factor=2.0))
    (tmp_path / "caller.py").write_text(KERNEL + "from callee import much as asked\n")
    assert answer(tmp_path) == 2.0  # now its code is on disk
    script = (
        "from gcs.cli.service.memory import save_memory; save_memory();"
        "import pathlib, sys; import gcs.model.jit as c; import numba;"
        f"folder = pathlib.Path({str(tmp_path)!r}); sys.path.insert(0, str(folder));"
        "c.KEPT_IN = folder / 'kept';"
        "from callee import much; assert much(1.0) == 2.0;"
        "library = next(iter(much.overloads.values())).library; print(library.dropped is not None);"
        "more = numba.njit(lambda x: much(x) + 1.0); print(more(1.0))"
    )
    done = subprocess.run([sys.executable, "-B", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "3.0"]
