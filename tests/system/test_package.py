"""What an installed wheel holds."""

import email
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import mypy
import pytest

from gcs.cli.local_files import names as names_of_documents

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.computes


@pytest.mark.soak
def test_wheel_contains_configurations_and_the_fake_fleet(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(build, check=True, cwd=ROOT, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    names = {str(path.relative_to(tmp_path / "site")) for path in (tmp_path / "site").rglob("*")}
    assert {"gcs/_configs/demo.yaml", "gcs/py.typed", "gcs/sim/px4_params.json"} <= names
    assert "gcs/sim/autopilots/ardupilot/parameters.json" in names
    assert {"gcs/api/console/dist/index.html", "gcs/api/console/dist/docs.html"} <= names
    own = {name for name in names if "/" not in name and not name.endswith(".dist-info")}
    assert own == {"gcs"}  # a user's own package `api` or `sim` is not shadowed
    assert {f"gcs/_docs/{name}" for name in names_of_documents()} <= names
    check_links(tmp_path / "site" / "gcs" / "_docs")
    page = (tmp_path / "site" / "gcs" / "api" / "console" / "dist" / "index.html").read_text(encoding="utf-8")
    scripts = [name for name in names if name.endswith(".js")]
    assert scripts
    assert all(name.startswith("gcs/api/console/dist/assets/") for name in scripts)
    assert any(Path(name).name in page for name in scripts)
    assert all({f"{name}.br", f"{name}.gz"} <= names for name in scripts)
    assert not [name for name in names if name.endswith((".ts", "package.json")) or "node_modules" in name]
    code = "from gcs.config import schema as s; print(s.find('demo'), len(s.load(s.find('px4-sitl')).ids))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        capture_output=True,
        text=True,
        cwd=tmp_path / "site",
        env={"PYTHONPATH": str(tmp_path / "site")},
    )
    where, count = done.stdout.split()
    assert Path(where) == tmp_path / "site" / "gcs" / "_configs" / "demo.yaml"
    assert count == "4"
    (metadata,) = (tmp_path / "site").glob("formation_gcs-*.dist-info/METADATA")
    described = email.message_from_string(metadata.read_text(encoding="utf-8"))
    assert {each.split(",")[0] for each in described.get_all("Project-URL", [])} >= {
        "Source",
        "Changelog",
        "Issues",
    }
    assert described["Author"]
    assert "Typing :: Typed" in described.get_all("Classifier", [])
    links = re.findall(r'\]\(([^)]+)\)|src="([^"]+)"', str(described.get_payload()))
    assert len(links) > 5
    assert all("".join(link).startswith("https://") for link in links)
    check_types(tmp_path)
    check_headless(tmp_path, described)


def check_links(documents: Path) -> None:
    """What a document in the wheel links to is in the wheel, or has an address."""
    links = [
        (page, link)
        for page in documents.rglob("*.md")
        for link in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
    ]
    assert len(links) > 100
    assert not [
        (page, link)
        for page, link in links
        if not link.startswith(("https://", "http://")) and not (page.parent / link).is_file()
    ]


def check_headless(folder: Path, described: email.message.Message) -> None:
    """Without the extra `plots` nothing asks for matplotlib; commands that draw name the extra at once."""
    needed = [each for each in described.get_all("Requires-Dist", []) if "extra ==" not in each]
    assert any(each.startswith("scipy") for each in needed)
    assert not [each for each in needed if each.startswith("matplotlib")]
    assert "plots" in described.get_all("Provides-Extra", [])
    others = folder / "headless"
    others.mkdir()
    for path in Path(mypy.__file__).parents[1].iterdir():
        if not path.name.startswith(("matplotlib", "mpl_toolkits", "pylab", "formation_gcs")):
            (others / path.name).symlink_to(path)
    environment = {"PYTHONPATH": f"{folder / 'site'}:{others}", "PATH": "/usr/bin:/bin", "HOME": str(folder)}

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-S", "-m", "gcs", *words]  # -S: no site-packages but those
        return subprocess.run(
            command, check=False, capture_output=True, text=True, cwd=folder, env=environment
        )

    serve = run("serve", "--config", "no-such-file")
    assert serve.returncode == 2
    assert "no-such-file" in serve.stderr
    assert run("show", "hash", "lighthouse").returncode == 0
    for words in (
        ("simulate", "assembly", "--plot", "flight.png"),
        ("show", "plot", "lighthouse", "show.png"),
        ("report", "runs", "--html", "page.html"),
    ):
        done = run(*words)
        assert done.returncode == 2, words
        assert "pip install 'formation-gcs[plots]'" in done.stderr, done.stderr


def check_types(folder: Path) -> None:
    """A program that uses the installed client sees its types, and mypy the program's mistakes."""
    (folder / "program.py").write_text(
        "from gcs.client import Client\n\nwith Client() as client:\n"
        "    reveal_type(client.show().phase)\n    client.change_formation(radius_m='wide')\n"
    )
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "env")], check=True)
    (packages,) = (folder / "env").glob("lib/*/site-packages")
    shutil.copytree(folder / "site", packages, dirs_exist_ok=True)
    others = Path(mypy.__file__).parents[1]  # what the wheel needs; a .pth in there is not followed
    (packages / "others.pth").write_text(f"{others}\n")
    command = [sys.executable, "-m", "mypy", "--python-executable", str(folder / "env" / "bin" / "python")]
    command += ["--strict", "--config-file", os.devnull, "--cache-dir", str(folder / "mypy"), "program.py"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=folder)
    assert 'Revealed type is "gcs.model.lifecycle.ShowPhase"' in done.stdout, done.stdout
    assert 'Argument "radius_m" to "change_formation"' in done.stdout


@pytest.mark.soak
def test_an_sdist_builds_the_page_for_itself(tmp_path: Path) -> None:
    hatchling = [sys.executable, "-m", "hatchling", "build", "--directory", str(tmp_path), "--target"]
    subprocess.run([*hatchling, "sdist"], check=True, cwd=ROOT, capture_output=True)
    (sdist,) = tmp_path.glob("*.tar.gz")
    shutil.unpack_archive(sdist, tmp_path, filter="data")
    (source,) = tmp_path.glob("formation_gcs-*/")
    assert not (source / "api" / "console" / "dist").exists()
    assert (source / "sim" / "cli.py").is_file()
    (node,) = ROOT.glob(".venv-node/lib/*/site-packages")  # as a build frontend brings it
    alone = {"PYTHONPATH": str(node), "PATH": "/usr/bin:/bin"}
    subprocess.run([*hatchling, "wheel"], check=True, cwd=source, capture_output=True, env=os.environ | alone)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as built:
        names = set(built.namelist())
        assert {"gcs/api/app.py", "gcs/sim/px4_params.json", "gcs/cli/main.py"} <= names
        assert b"/assets/" in built.read("gcs/api/console/dist/index.html")


@pytest.mark.parametrize("lock", [f"requirements{part}.lock" for part in ("", "-docs", "-mutate", "-node")])
def test_the_locks_name_no_host(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    assert "://" not in text
    assert "--hash=sha256:" in text


def test_console_builds_from_locked_packages_of_any_registry() -> None:
    lock = json.loads((ROOT / "api" / "console" / "package-lock.json").read_text(encoding="utf-8"))
    packages = [each for name, each in lock["packages"].items() if name]
    assert len(packages) > 5
    assert all(each["integrity"].startswith("sha512-") for each in packages)
    assert not [each for each in packages if "resolved" in each]
