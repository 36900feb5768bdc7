"""A feature has few doors: files that name it in their code, without comments and docstrings, are counted."""

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import pytest

ROOT: Final = Path(__file__).parents[2]
SOURCES: Final = ("gcs", "api", "sim")
LEFT_OUT: Final = (
    "gcs/testing",
    "api/console/test",
    "api/console/src/schemas/schema.ts",
    "gcs/api",
    "gcs/sim",
)
"""Tests, what is generated of other files, and links to folders that are counted themselves."""
COMMENT: Final = re.compile(r"/\*.*?\*/|(?<![:\"'])//[^\n]*", re.DOTALL)


class Named(NamedTuple):
    """How code names a feature, and in how many files at most: its own, by their paths, and others."""

    words: str
    own: str
    own_max: int
    others_max: int


FEATURES: Final = {
    "corrections": Named(
        r"rtcm|RTCM|RtkSettings|\brtk\b(?!-)|(?<![a-z])corrections(?![a-z])|Correction|CORRECTIONS",
        r"corrections|rtcm|rtk",
        4,
        6,
    ),
    "timecode": Named(r"[Tt]imecode|TIMECODE", r"timecode", 9, 6),
    "lights": Named(
        r"(?<![A-Za-z])[Ll]ights?(?![a-z])|(?<![A-Z])LIGHTS?(?![A-Z])",
        r"lights?|shows|drawn_\w+",  # a show's lights are its content
        19,
        5,
    ),
    "targets": Named(  # those that are tracked; "target" alone is also where the plan has the formation
        r"Targets?View|TargetFix|TargetEstimate|TargetReport|TargetSettings|\bTracker\b|features\??\.targets"
        r"|(?:state|estimation|links|sim) \. targets\b|\./targets",
        r"targets?|tracker",
        18,  # each source is a file; the WebSocket and the receiver of traffic are among them
        17,  # traffic, and where the operator of Remote ID is, are received as targets are
    ),
    "go": Named(
        r"GoView|GoSettings|CrewGo|GoByTwo|ProposedStart|WeatherEntry|features\??\.go\b|\./go\b",
        r"go|weather|checklists",
        6,
        10,
    ),
    "tak": Named(r"\bTak[A-Z]|TAK_|OwnTracks?|\btak\b", r"tak|cot\w*", 5, 12),
    "fences": Named(  # in the autopilots; the service's own is `gcs/safety/walls.py`
        r"Fences?View|FenceUploads|PolygonFence|FenceTransfers?|features\??\.fences|\./fences",
        r"fences?|polygon_fence|fence_\w+",
        8,
        6,
    ),
    "remote id": Named(
        r"RemoteId[A-Z]\w+|\bRemoteId\b|\bremote_id\b|\./remoteId",
        r"remote_id|remoteId",
        7,
        10,  # a site's report says what is sent
    ),
    "wind": Named(  # measured; that of the simulated world and of the settings has other names
        r"Wind(?:View|Watch|Settings|Estimat\w+)|features\??\.wind\b|\./wind", r"wind", 3, 4
    ),
    "traffic": Named(  # of others; `gcs/safety/traffic.py` is of the own vehicles
        r"TrafficView|TrafficSettings|TrafficSource|TrackTable|OtherTraffic|features\??\.traffic|\./traffic",
        r"traffic|tracks",
        6,
        9,
    ),
}


def python_code(text: str) -> Iterator[str]:
    """What runs: not comments, nor strings that stand alone."""
    begins = True
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in {tokenize.NEWLINE, tokenize.NL, tokenize.INDENT, tokenize.DEDENT}:
            begins = begins or token.type == tokenize.NEWLINE
        elif token.type != tokenize.COMMENT:
            if not (begins and token.type == tokenize.STRING):
                yield token.string
            begins = False


def code(file: Path) -> str:
    text = file.read_text(encoding="utf-8")
    return " ".join(python_code(text)) if file.suffix == ".py" else COMMENT.sub("", text)


def sources(root: Path) -> dict[str, str]:
    """Code of each file, by its path."""
    files = [file for name in SOURCES for file in (root / name).rglob("*") if file.suffix in {".py", ".ts"}]
    named = {file.relative_to(root).as_posix(): file for file in files if "node_modules" not in file.parts}
    return {name: code(file) for name, file in named.items() if not name.startswith(LEFT_OUT)}


@pytest.fixture(scope="module")
def found() -> dict[str, str]:
    return sources(ROOT)


@pytest.mark.long
@pytest.mark.parametrize("feature", FEATURES)
def test_few_files_beside_its_own_name_a_feature(feature: str, found: dict[str, str]) -> None:
    words, own, own_max, others_max = FEATURES[feature]
    named = {name for name, text in found.items() if re.search(words, text)}
    own_files = {name for name in named if re.search(rf"(?<![a-z])(?:{own})(?![a-z])", name)}
    assert len(own_files) <= own_max, sorted(own_files)
    assert len(named - own_files) <= others_max, sorted(named - own_files)
