import json
import logging
from pathlib import Path

import pytest

from gcs.api.auth.tokens import Tokens, create_token, read_tokens, revoke_token
from gcs.cli.main import main
from gcs.config import schema as configuration
from gcs.model.errors import ConfigError, RefusedError, UnknownError
from gcs.service.access import Role


def test_only_the_token_hash_is_stored_in_a_private_file(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    token = create_token(path, "crew", Role.OPERATE)
    assert token not in path.read_text()
    assert path.stat().st_mode & 0o777 == 0o600
    found = Tokens(path).find(token)
    assert found is not None
    assert (found.name, found.role) == ("crew", Role.OPERATE)
    for other in (
        "",
        "crew",
        found.sha256,
        token[:-1],
        f"{token} ",
        token.upper(),
        "ü\udcff".encode("utf-8", "replace").decode(),
    ):
        assert Tokens(path).find(other) is None


def test_tokens_are_long_and_unique(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    made = {create_token(path, f"t{number}", Role.WATCH) for number in range(20)}
    assert len(made) == 20
    assert min(map(len, made)) > 40
    assert [entry.name for entry in read_tokens(path)] == [f"t{number}" for number in range(20)]


def test_a_running_service_learns_of_new_and_revoked_tokens(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    crew = create_token(path, "crew", Role.OPERATE)
    tokens = Tokens(path)
    entry = tokens.find(crew)
    assert entry is not None
    button = create_token(path, "button", Role.EMERGENCY)
    assert tokens.find(button) is not None
    revoke_token(path, "crew")
    assert tokens.find(crew) is None
    assert not tokens.has(entry)
    assert tokens.find(button) is not None


def test_file_broken_at_runtime_keeps_existing_access(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "tokens.json"
    crew = create_token(path, "crew", Role.OPERATE)
    tokens = Tokens(path)
    path.write_text("{")
    with caplog.at_level(logging.ERROR):
        assert tokens.find(crew) is not None
        path.unlink()
        assert tokens.find(crew) is not None
    assert [record.getMessage() for record in caplog.records] == ["tokens_not_read_again"] * 2


GOOD = {"name": "a", "role": "watch", "sha256": "0" * 64, "created_unix_time_s": 0}


@pytest.mark.parametrize(
    ("text", "stated"),
    [
        ("", "no token file"),
        ("[]", "no token file"),
        (json.dumps({"tokens": [{**GOOD, "role": "king"}]}), r"tokens\.0\.role: Input should be 'watch'"),
        (json.dumps({"tokens": [{**GOOD, "sha256": "00"}]}), r"tokens\.0\.sha256"),
        (json.dumps({"tokens": [{**GOOD, "name": ""}]}), r"tokens\.0\.name"),
        (json.dumps({"tokens": [GOOD], "more": 1}), "more: Extra inputs"),
        (json.dumps({"tokens": [GOOD, GOOD]}), "a is there twice"),
        ('{"tokens": []}', "no token in it; gcs token create NAME"),
    ],
)
def test_invalid_token_file_is_refused_with_the_problem(tmp_path: Path, text: str, stated: str) -> None:
    path = tmp_path / "tokens.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match=stated):
        Tokens(path)
    assert path.read_text() == text


def test_missing_file_is_refused_with_the_command_to_create_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"gcs token create NAME --role operate --file .*none\.json"):
        Tokens(tmp_path / "none.json")


@pytest.mark.parametrize("name", ["", "anonymous", "local", "service", "two words", "x" * 65, "-x"])
def test_a_bad_name_makes_no_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(RefusedError, match="name"):
        create_token(tmp_path / "tokens.json", name, Role.WATCH)
    assert list(tmp_path.iterdir()) == []


def test_duplicate_and_unknown_names_change_nothing(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    create_token(path, "crew", Role.OPERATE)
    before = path.read_bytes()
    with pytest.raises(RefusedError, match="there is a token crew already"):
        create_token(path, "crew", Role.WATCH)
    with pytest.raises(UnknownError, match="no token pilot; there are crew"):
        revoke_token(path, "pilot")
    assert path.read_bytes() == before


def test_the_command_creates_lists_and_revokes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = ["--file", str(tmp_path / "tokens.json")]
    assert main(["token", "create", "crew", "--role", "operate", *file]) == 0
    token = capsys.readouterr().out.strip()
    assert Tokens(tmp_path / "tokens.json").find(token) is not None
    assert main(["token", "list", *file]) == 0
    listed = capsys.readouterr().out
    assert listed.split()[:2] == ["crew", "operate"]
    assert token not in listed
    assert main(["token", "revoke", "crew", *file]) == 0
    assert main(["token", "revoke", "crew", *file]) == 1
    assert "there is no token crew; there are none" in capsys.readouterr().err
    assert main(["token", "list", "--file", str(tmp_path / "no" / "such")]) == 1
    assert "cannot be read" in capsys.readouterr().err


def config_with(**sections: object) -> configuration.Config:
    raw = configuration.load(configuration.find("demo")).model_dump()
    return configuration.Config.model_validate(raw | sections)


@pytest.mark.parametrize(
    "host", ["10.0.0.1", "::", "192.168.1.7", "station.local", "", "127.0.0.1.evil.example"]
)
def test_beyond_loopback_tokens_are_needed(host: str) -> None:
    with pytest.raises(ValueError, match=r"beyond 127\.0\.0\.1 tokens are needed: gcs token create NAME"):
        config_with(api={"host": host})
    assert config_with(api={"host": host}, access={"tokens_file": "tokens.json"}).api.host == host


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.1.2.3"])
def test_on_loopback_no_tokens_are_needed(host: str) -> None:
    assert config_with(api={"host": host}).access.tokens_file is None


@pytest.mark.parametrize(
    ("api", "stated"),
    [({"port": 65535}, "emergency_port = 65536"), ({"port": 80, "emergency_port": 80}, "not port itself")],
)
def test_emergency_port_is_a_separate_port(api: dict[str, int], stated: str) -> None:
    with pytest.raises(ValueError, match=stated):
        config_with(api=api)


@pytest.mark.usefixtures("logging_restored")
def test_command_line_of_serve_is_checked_like_the_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["serve", "--config", "demo", "--host", "10.0.0.1", "--quiet"]) == 2
    assert "api.host = 10.0.0.1: beyond 127.0.0.1 tokens are needed" in capsys.readouterr().err
