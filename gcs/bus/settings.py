"""Settings of the bus, where stations listen, and the files with which they know each other."""

import re
from pathlib import Path
from typing import Annotated

from pydantic import Field, field_validator

from gcs.model.settings import Settings
from gcs.service.access import is_loopback


class BusSettings(Settings):
    """The bus of a site; each station's own endpoint is listed with the station."""

    lease_s: Annotated[float, Field(ge=0.1, le=10.0)] = 0.2
    """Silence of a station, beyond its watchdog's time, after which its standby takes over, in s."""
    lead_silent_s: Annotated[float, Field(ge=0.5, le=60.0)] = 2.0
    """For so long the last plan of a silent lead is flown, in s; then all hold."""
    standby_rejoins: bool = False
    """Whether vehicles that a standby took over go back into formation without a command."""
    keys: Path | None = None
    """Folder of `gcs key site`; null: without TLS, on loopback only."""


class Endpoint(Settings):
    """Where a station listens for the others."""

    host: str
    """Address or name under which the other stations reach it."""
    port: Annotated[int, Field(ge=1, le=65535)]
    """TCP port of the bus."""

    @field_validator("host")
    @classmethod
    def _bare(cls, host: str) -> str:
        if re.fullmatch(r"[A-Za-z0-9.:%_-]{1,253}", host) is None:
            raise ValueError("a host name or an address, as 10.0.0.1")
        if host in {"0.0.0.0", "::"}:  # noqa: S104 (refused)
            raise ValueError("an address under which the others reach it")
        return host

    @property
    def is_loopback(self) -> bool:
        return is_loopback(self.host)

    def url(self, *, tls: bool) -> str:
        """The endpoint as Zenoh writes it."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'tls' if tls else 'tcp'}/{host}:{self.port}"


def key_files(folder: Path, station: str) -> tuple[Path, Path, Path]:
    """Certificate of the site's authority, the station's certificate, and its key."""
    return folder / "ca.pem", folder / f"{station}.pem", folder / f"{station}.key"
