"""What `gcs` loads before it does anything, and how it says what it can do."""

import json
import os
import signal
import subprocess
import sys
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from gcs.cli import options
from gcs.cli.commands import ACTIONS, CALLS, COMMANDS, names
from gcs.cli.demo.demo import VEHICLES_MAX
from gcs.cli.main import load, main, whole_parser
from gcs.cli.progress import part_of, share_of
from gcs.simulation.cores import on_all_cores

NO_SERVICE = "http://127.0.0.1:9"

HEAVY = ("numpy", "numba", "scipy", "matplotlib", "fastapi", "starlette", "uvicorn", "pymavlink", "mavsdk")
MODELS = ("pydantic", "gcs.api.schemas.fleet", "gcs.service", "gcs.config.schema", "yaml", "sqlite3")

LOADED = """
import sys
from gcs.cli.main import main
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print("\\n".join(sorted(sys.modules)), file=sys.stderr)
"""


def loaded(line: str) -> set[str]:
    """The modules that are there after a command, in a process of its own."""
    command = [sys.executable, "-c", LOADED, *line.split()]
    result = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return set(result.stderr.splitlines())


@pytest.mark.parametrize(
    "line", ["--help", "--version", "kil", "demo --help", "serve --help", "simulate --help"]
)
def test_help_and_usage_errors_load_only_the_command_table(line: str) -> None:
    assert loaded(line) & {*HEAVY, *MODELS, "httpx", "rich", "asyncio", "gcs.client.fleet_client"} == set()


@pytest.mark.parametrize(
    "line",
    [
        "kill --help",
        "phase --help",
        "status --help",
        f"stop --url {NO_SERVICE}",
        f"pause --url {NO_SERVICE}",
        f"land d1 d2 --url {NO_SERVICE}",
        f"status --url {NO_SERVICE}",
        f"phase --json --url {NO_SERVICE}",
        f"shows list --url {NO_SERVICE}",
    ],
)
def test_a_call_is_sent_before_any_model_or_array_is_loaded(line: str) -> None:
    assert loaded(line) & {*HEAVY, *MODELS} == set()


def test_client_loads_neither_arrays_nor_the_server() -> None:
    command = [sys.executable, "-c", "import sys, gcs.client.fleet_client; print(*sys.modules)"]
    result = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert set(result.stdout.split()) & {*HEAVY, *MODELS} == set()


def test_every_command_is_in_the_help_with_a_text_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    for name, text in names().items():
        assert f"  {name} " in shown
        assert text in shown
    texts = [*names().values(), *(call.text for call in CALLS), *(action.text for action in ACTIONS)]
    assert all(0 < len(text) <= 76 and "`" not in text and "None" not in text for text in texts)
    assert all(len(line) <= 100 for line in shown.splitlines())


def test_every_listed_command_exists_and_has_help() -> None:
    for name, command in COMMANDS.items():
        assert callable(load(command.options or command.module, f"add_{name}_arguments"))
        assert name in {"key", "token"} or callable(load(command.module, f"run_{name}"))
    help_of_all = whole_parser().format_help()
    assert "completion" in help_of_all


def test_transports_of_the_demo_are_the_options() -> None:
    assert sorted(VEHICLES_MAX) == sorted(options.TRANSPORTS)


@pytest.mark.parametrize(
    ("line", "usage", "wrong"),
    [
        ("phase --foo", "usage: gcs phase ", "unrecognized arguments: --foo"),
        ("target set 1", "usage: gcs target set ", "Y_M"),
        ("kil", "usage: gcs COMMAND", "there is no command 'kil'; did you mean kill?"),
        ("orbit shw", "usage: gcs orbit COMMAND", "did you mean show?"),
        ("show", "usage: gcs show ", "required: action"),
    ],
)
def test_usage_error_shows_that_command_only(
    line: str, usage: str, wrong: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    result = capsys.readouterr().err
    assert ended.value.code == 2
    assert result.startswith(usage)
    assert wrong in result
    assert len(result.splitlines()) < 9


def test_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("gcs 0.")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_completes_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(name in script for name in names())


@pytest.mark.soak
def test_bash_completes_a_command_and_its_options(tmp_path: Path) -> None:
    script = tmp_path / "gcs.bash"
    with script.open("w") as file:
        subprocess.run(
            [sys.executable, "-m", "gcs", "completion", "bash"], stdout=file, check=True, timeout=60
        )
    asked = (
        f"source {script}; COMP_WORDS=(gcs target set-g); COMP_CWORD=2; _shtab_gcs; echo ${{COMPREPLY[@]}};"
        " COMP_WORDS=(gcs kill --al); COMP_CWORD=2; _shtab_gcs; echo ${COMPREPLY[@]}"
    )
    result = subprocess.run(
        ["/bin/bash", "-c", asked], capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout.split() == ["set-geodetic", "--all"]


def test_reader_that_closes_early_gets_no_traceback() -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "gcs", "--help"]
    try:
        result = subprocess.run(
            command, stdout=write, stderr=subprocess.PIPE, text=True, check=False, timeout=60
        )
    finally:
        os.close(write)
    assert (result.returncode, result.stderr) == (141, "")


def test_ctrl_c_while_loading_ends_without_a_traceback(tmp_path: Path) -> None:
    (tmp_path / "numba.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    command = [sys.executable, "-m", "gcs", "serve", "--config", "demo"]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, env=environment)
    assert (result.returncode, result.stdout, result.stderr) == (128 + signal.SIGINT, "", "")


def test_tokens_keys_and_hashes_are_printed_as_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = f"--file={tmp_path / 'tokens.json'}"
    assert main(["token", "create", "crew", "--role", "watch", "--json", file]) == 0
    made = json.loads(capsys.readouterr().out)
    assert (made["name"], made["role"], made["token"][:4]) == ("crew", "watch", "gcs_")
    assert main(["token", "list", "--json", file]) == 0
    assert [each["name"] for each in json.loads(capsys.readouterr().out)] == ["crew"]
    assert main(["token", "revoke", "crew", "--json", file]) == 0
    assert json.loads(capsys.readouterr().out) == {"revoked": "crew"}
    assert main(["key", "create", str(tmp_path / "link.key"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"file": str(tmp_path / "link.key")}
    assert main(["show", "hash", "lighthouse", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["hash"]) == 64


def test_progress_is_shown_on_a_terminal_and_nowhere_else() -> None:
    shown = {}
    for is_terminal in (True, False):
        console = Console(file=StringIO(), force_terminal=is_terminal, width=80)
        assert list(on_all_cores(abs, [-1, -2, -3], 1, progress=True, console=console)) == [1, 2, 3]
        shown[is_terminal] = console.file.getvalue()  # type: ignore[attr-defined]
    assert "flying 3 in virtual time" in shown[True]
    assert "100%" in shown[True]
    assert shown[False] == ""


def test_progress_in_percent_never_decreases() -> None:
    def shown(*, is_terminal: bool, desired: bool) -> str:
        console = Console(file=StringIO(), force_terminal=is_terminal, width=80)
        with share_of("judging the flight", console, shown=desired) as report:
            part_of(report, 0.5, 1.0)(0.5)
            report(0.25)
        text: str = console.file.getvalue()  # type: ignore[attr-defined]
        return text

    assert "judging the flight" in shown(is_terminal=True, desired=True)
    assert shown(is_terminal=True, desired=True).split("%")[-2].endswith("75")
    assert shown(is_terminal=True, desired=False) == shown(is_terminal=False, desired=True) == ""


@pytest.mark.soak
def test_simulate_says_that_it_compiles(tmp_path: Path) -> None:
    words, environment = (
        ["-m", "gcs", "simulate", "assembly"],
        {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
    )
    with subprocess.Popen(
        [sys.executable, *words], env=environment, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stderr is not None
        assert run.stderr.readline().startswith("gcs: compiling the law first")
        run.kill()


def test_shipped_files_are_listed_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["files", "list"]) == 0
    names_of_files = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert {"operations.md", "grafana/formation.json", "formation-gcs.service"} <= set(names_of_files)
    for name in names_of_files:
        assert main(["files", "show", name]) == 0
        assert len(capsys.readouterr().out) > 100
    assert main(["files", "show", "../pyproject.toml"]) == 2
