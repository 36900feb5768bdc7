"""Settings of recording, signing, streams and forwarding."""

import re
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field, model_validator

from gcs.model.errors import ConfigError
from gcs.model.settings import NotNegative, Positive, Settings

_URL: Final = re.compile(r"^udp://(?P<host>\d{1,3}(?:\.\d{1,3}){3}):(?P<port>\d{1,5})$")


class RecordSettings(Settings):
    """What is recorded of every flight.

    In `folder`: `audit.sqlite`, and for each run of the service a folder with flight data and with every
    frame of each link.
    """

    folder: Path
    flight: bool = True  # flight data at the tick's rate, MCAP
    frames: bool = True  # every frame, .tlog


class SigningSettings(Settings):
    """MAVLink 2 signing. `link_id` distinguishes links that share a key."""

    key_file: Path
    link_id: Annotated[int, Field(ge=0, le=255)] = 0


class StreamSettings(Settings):
    """Rates of the vehicles' reports; `others_hz` is for messages that only further stations use."""

    position_hz: Positive = 10.0  # the tick brings positions forward with their velocities
    state_hz: Positive = 5.0
    others_hz: NotNegative = 0.0


class Forward(Settings):
    """A further ground station. What one that is not read-only may do: docs/decisions/0009."""

    url: Annotated[str, Field(pattern=_URL.pattern)]
    read_only: bool = True

    @property
    def address(self) -> tuple[str, int]:
        """Host and port. Raises: ConfigError."""
        found = _URL.match(self.url)
        if found is None:
            raise ConfigError(f"forward: {self.url}: udp://ADDRESS:PORT is needed")
        return found["host"], int(found["port"])

    @model_validator(mode="after")
    def _check(self) -> "Forward":
        host, port = self.address
        try:
            IPv4Address(host)
        except AddressValueError as error:
            raise ValueError(f"url: {error}") from None
        if not 1 <= port <= 65535:
            raise ValueError(f"url: port {port}: 1 to 65535")
        return self
