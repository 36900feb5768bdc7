"""The section `timecode` of a configuration."""

import pytest
from pydantic import ValidationError

from gcs.links.features import TimecodeSettings


@pytest.mark.parametrize(
    ("source", "scheme", "path", "address"),
    [
        ("rtp-midi://0.0.0.0:5004", "rtp-midi", "", ("0.0.0.0", 5004)),  # noqa: S104 (read, not opened)
        ("udp-midi://127.0.0.1:5006", "udp-midi", "", ("127.0.0.1", 5006)),
        ("midi:///dev/snd/midiC1D0", "midi", "/dev/snd/midiC1D0", None),
        ("ltc:///run/gcs/ltc:48000", "ltc", "/run/gcs/ltc", None),
    ],
)
def test_sources(source: str, scheme: str, path: str, address: tuple[str, int] | None) -> None:
    settings = TimecodeSettings(source=source)
    assert (settings.scheme, settings.path) == (scheme, path)
    if address is not None:
        assert settings.address == address
    if scheme == "ltc":
        assert settings.sample_rate_hz == 48_000.0


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"source": ""}, "is needed"),
        ({"source": "udp-midi://desk:5006"}, "is needed"),
        ({"source": "udp-midi://300.0.0.1:5006"}, "no IP address"),
        ({"source": "udp-midi://127.0.0.1:0"}, "a port up to"),
        ({"source": "rtp-midi://127.0.0.1:65535"}, "a port up to"),
        ({"source": "midi://relative"}, "is needed"),
        ({"source": "ltc:///run/ltc"}, "is needed"),
        ({"source": "ltc:///run/ltc:100"}, "samples a second"),
        ({"source": "midi:///dev/midi", "starts_at": "24:00:00:00"}, "starts_at"),
        ({"source": "midi:///dev/midi", "starts_at": "soon"}, "starts_at"),
        ({"source": "midi:///dev/midi", "catch_up": 1.0}, "catch_up"),
        ({"source": "midi:///dev/midi", "jump_max_s": 1e9}, "jump_max_s"),
        ({"source": "midi:///dev/midi", "freewheel": 1}, "freewheel"),
    ],
)
def test_what_cannot_be_a_source_is_refused(values: dict[str, object], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        TimecodeSettings.model_validate(values)
