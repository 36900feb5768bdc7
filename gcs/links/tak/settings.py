"""Settings of groups and servers of TAK. No I/O."""

from pathlib import Path
from typing import Annotated, NamedTuple, TypeAlias

from pydantic import Field

from gcs.links.settings import Reachable
from gcs.model.settings import Settings

TakAddress: TypeAlias = Annotated[
    str, Field(pattern=r"^(udp|tcp|tls)://[A-Za-z0-9.-]{1,253}:\d{1,5}$"), Reachable
]
Geoid: TypeAlias = Annotated[float, Field(ge=-110, le=90)]


class OwnTracks(NamedTuple):
    """What a show sends as tracks itself, and may receive again: no target, and no traffic."""

    uid: str = ""  # with which the uid of each begins; empty: it sends none
    number: int = 0


class TakPlace(Settings):
    """How a group or a server of TAK is reached."""

    interface: Annotated[str, Field(pattern=r"^(\d{1,3}(\.\d{1,3}){3})?$")] = ""
    """IP address of this computer, at which a multicast group is used; empty: where the route leads."""
    certificate: Path | None = None
    """Client certificate for `tls://`, PEM with its key."""
    authority: Path | None = None
    """Certificate of the authority that signed the server's; without it those of this computer count."""


class TakReceiver(TakPlace):
    """Where people have TAK; its URL alone is enough."""

    at: TakAddress
    """`udp://HOST:PORT` of a device or a multicast group; `tcp://` or `tls://` a server."""
