from pathlib import Path

import pytest

from gcs.cli.main import main
from gcs.links.signing_key import load_key


def test_key_file_is_private_and_never_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "fleet"
    assert main(["key", "create", str(path)]) == 0
    assert path.stat().st_mode & 0o777 == 0o600
    key = load_key(path)
    assert main(["key", "create", str(path)]) == 2
    assert "cannot be made" in capsys.readouterr().err
    assert load_key(path) == key
