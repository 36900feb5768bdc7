from base64 import b64encode
from functools import partial
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links.signing import Signing, create_key
from gcs.links.signing_key import load_key
from gcs.model.errors import ConfigError, LinkError

KEY = bytes(range(200, 232))
HEX = KEY.hex().encode()
WALL_S = 1_790_000_000.0
BEAT = bytes(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(dialect.MAVLink(None, srcSystem=245)))


def key_file(folder: Path, data: bytes = KEY) -> Path:
    path = folder / "key"
    path.write_bytes(data)
    path.chmod(0o600)
    return path


@pytest.mark.parametrize(
    "data",
    [
        KEY,
        KEY.hex().encode(),
        KEY.hex().upper().encode() + b"\r\n",
        b64encode(KEY),
        b" " + b64encode(KEY) + b"\n",
    ],
)
def test_a_key_may_be_raw_hex_or_base64(tmp_path: Path, data: bytes) -> None:
    assert load_key(key_file(tmp_path, data)) == KEY


@pytest.mark.parametrize("data", [b"", KEY[:31], KEY + b"\n", b"password", HEX[:-2], bytes(4096)])
def test_a_key_of_another_size_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(ConfigError, match=rf"key: {len(data)} bytes; a signing key is 32 bytes"):
        load_key(key_file(tmp_path, data))


def test_a_key_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere: the signing key cannot be read"):
        load_key(tmp_path / "nowhere")


def test_key_that_others_can_read_raises_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = key_file(tmp_path)
    load_key(path)
    assert caplog.records == []
    path.chmod(0o640)
    load_key(path)
    assert [(record.msg, vars(record)["fix"]) for record in caplog.records] == [
        ("key_file_open", f"chmod 600 {path}")
    ]


def test_a_new_key_is_good_and_overwrites_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "new"
    create_key(path)
    assert len(load_key(path)) == 32
    assert caplog.records == []
    with pytest.raises(ConfigError, match="cannot be made"):
        create_key(path)


def signed_time(signing: Signing) -> int:
    signed = signing.signer.sign(BEAT)
    assert signed is not None
    return int.from_bytes(signed[-12:-6], "little")


def test_time_goes_on_after_a_restart_with_the_clock_set_back(tmp_path: Path) -> None:
    path = key_file(tmp_path)
    times = []
    for wall_s in (WALL_S, WALL_S - 86400.0, WALL_S - 400 * 86400.0):
        signing = Signing(path, 1, wall_clock=partial(float, wall_s))
        signing.open()
        times += [signed_time(signing), signed_time(signing)]
        signing.close()
    assert times == sorted(set(times))


def test_time_continues_after_a_crash(tmp_path: Path) -> None:
    path = key_file(tmp_path)
    first = Signing(path, 1, wall_clock=lambda: WALL_S)
    first.open()
    before = max(signed_time(first) for _ in range(1000))
    second = Signing(path, 1, wall_clock=lambda: WALL_S - 3600.0)  # the first was never closed
    second.open()
    assert signed_time(second) > before
    second.close()
    first.close()


def test_links_that_share_a_key_have_times_of_their_own(tmp_path: Path) -> None:
    path = key_file(tmp_path)
    for link_id in (1, 2):
        signing = Signing(path, link_id)
        signing.open()
        signing.close()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["key", "key.link1.time", "key.link2.time"]


@pytest.mark.parametrize("text", ["", "yesterday", "-5", "1" * 30])
def test_damaged_time_is_not_guessed(tmp_path: Path, text: str) -> None:
    path = key_file(tmp_path)
    (tmp_path / "key.link0.time").write_text(text)
    with pytest.raises(LinkError, match="holds no time"):
        Signing(path, 0).open()


def test_a_folder_where_the_time_cannot_be_kept_is_refused(tmp_path: Path) -> None:
    path = key_file(tmp_path)
    (tmp_path / "key.link0.time.new").mkdir()
    with pytest.raises(LinkError, match="cannot be kept"):
        Signing(path, 0).open()
