"""Reads configurations of commands that open links, and tests their addresses on this computer."""

import errno
import socket
from collections.abc import Iterator

from gcs.config import schema as configuration
from gcs.config import yaml_files as documents
from gcs.config.schema import Config
from gcs.config.setting_errors import Misfit
from gcs.config.yaml_files import Source
from gcs.links.endpoints.urls import Listen, TcpIn
from gcs.model.errors import FileError, Problem


def load_here(name: str) -> Config:
    """Load a configuration file, or a shipped configuration by name.

    Raises:
        ConfigError: names file, line, key, value and what is allowed; also for addresses that this
            computer does not have.
    """
    path = configuration.find(name)
    config = configuration.load(path)
    found = [*_misfits(config)]
    if found:
        written = Source(documents.read(path), str(path))
        raise FileError(str(path), [Problem(written.line(*one.loc), None, str(one)) for one in found])
    return config


def _misfits(config: Config) -> Iterator[Misfit]:
    """Yield the addresses of `listen` that do not belong to this computer."""
    for at, link in enumerate(config.links):
        for place, url in zip(link.places, link.listen, strict=True):
            if isinstance(place, Listen | TcpIn) and not _is_ours(place.host):
                text = f"this computer has no address {place.host}: one of its own, or 0.0.0.0 for all"
                yield Misfit(("links", at, "listen"), f"links.{at}.listen", f"'{url}'", text)
    if not _is_ours(config.api.host):
        text = "this computer has no such address: one of its own, or 127.0.0.1"
        yield Misfit(("api", "host"), "api.host", f"'{config.api.host}'", text)


def _is_ours(host: str) -> bool:
    """Whether this computer has that address; True when it cannot be tested."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
    except OSError:
        return False
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as trial:
        try:
            trial.bind(address)
        except OSError as error:
            return error.errno != errno.EADDRNOTAVAIL
    return True
