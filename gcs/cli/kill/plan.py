"""What a kill without the service needs: links, vehicles and their last known addresses.

They come from the service's record, or from its configuration where the record cannot be read. Both are read
as they are, and not checked as for a flight: whatever of them is usable serves, and at once.
"""

import json
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from gcs.model.errors import ConfigError, GcsError, RefusedError, UnknownError

BUSY_S: Final = 0.2
"""Longest wait for a service that writes."""

_MAVSDK_ID, _SPARE_ID = 245, 254
"""System ids of the station: `gcs.links.settings` says when it has which."""


@dataclass(frozen=True, slots=True)
class KillLink:
    """One link, as its settings say."""

    name: str
    urls: Sequence[str]
    ports: int  # of each UDP url
    system_ids: Mapping[str, int]  # by vehicle, in the order of the ports
    transport: str
    key_file: Path | None
    link_id: int

    @property
    def station_id(self) -> int:
        """System id of this station."""
        taken = self.transport != "mavsdk" or _MAVSDK_ID in self.system_ids.values()
        return _SPARE_ID if taken else _MAVSDK_ID


@dataclass(frozen=True, slots=True)
class KillPlan:
    """Every vehicle that can be killed without the service."""

    source: str  # in words
    links: Sequence[KillLink]
    addresses: Mapping[str, tuple[str, int]] = field(default_factory=dict)  # by vehicle, the last known
    record: Path | None = None  # None: it cannot be read

    def chosen(self, names: Sequence[str]) -> list[str]:
        """These vehicles, each once; without names all that were ever received, if that is known.

        Raises: UnknownError, RefusedError when there is none.
        """
        known = [name for link in self.links for name in link.system_ids]
        if not names:
            names = [name for name in known if name in self.addresses or self.record is None]
            if not names:
                raise RefusedError(f"{self.source}: no vehicle was ever received")
        if unknown := [name for name in names if name not in known]:
            there = ", ".join(known) or "none"
            raise UnknownError(f"{self.source}: no such vehicle: {', '.join(unknown)}; there are {there}")
        return [*dict.fromkeys(names)]

    def where(self, names: Sequence[str]) -> str:
        """Where a kill of these is sent, in words."""
        places: dict[str, list[str]] = {}
        for link in self.links:
            for name in (each for each in names if each in link.system_ids):
                host, port = self.addresses.get(name, ("", 0))
                place = f"{host}:{port}" if host else f"whatever sends its id to {', '.join(link.urls)}"
                places.setdefault(place, []).append(name)
        return "; ".join(f"{', '.join(there)}: {place}" for place, there in places.items())

    def stopped_since(self, unix_s: float) -> set[str]:
        """Vehicles whose motors the service has recorded as off since then."""
        if self.record is None:
            return set()
        try:
            rows = _rows(self.record, "SELECT id FROM vehicles WHERE armed = 0 AND unix_s >= ?", unix_s)
        except sqlite3.Error:
            return set()
        return {row["id"] for row in rows}


def links_in(name: str) -> list[KillLink]:
    """The links of a configuration's file. Raises: ConfigError."""
    from gcs.config import yaml_files  # noqa: PLC0415 (the record alone needs none)

    try:
        path = yaml_files.CONFIGURATIONS.find(name)
    except OSError as error:
        raise ConfigError(f"{name}: cannot be read: {error.strerror}") from None
    return links_of(yaml_files.Source(yaml_files.read(path), str(path)).mapping("links"), str(path))


def plan_of(record: Path, links: Sequence[KillLink] = (), source: str | None = None) -> KillPlan:
    """Read the record. `links` are those of a configuration, and `source` is its name. Raises: GcsError."""
    source = source or str(record)
    try:
        audit = record / "audit.sqlite" if record.is_dir() else record
        recorded, addresses = _recorded(audit)
        return KillPlan(source, links or links_of(recorded, source), addresses, audit)
    except (sqlite3.Error, ValueError, OSError) as error:
        problem = f"{record}: not an audit that can be read: {error}"
    except ConfigError as error:
        problem = str(error)
    if not links:
        raise GcsError(f"{problem}; the service's configuration serves as well: --config FILE")
    return KillPlan(source, links)


def _recorded(audit: Path) -> tuple[Mapping[str, Any], dict[str, tuple[str, int]]]:
    """The configuration of the newest session, and the last known addresses.

    Raises: ConfigError, sqlite3.Error, ValueError.
    """
    if not audit.is_file():
        raise ConfigError(f"{audit}: there is no such file; a service with a `record` writes audit.sqlite")
    sessions = _rows(audit, "SELECT config FROM sessions ORDER BY began_unix_s DESC, id DESC LIMIT 1")
    if not sessions:
        raise ConfigError(f"{audit}: no session is in this record")
    vehicles = _rows(audit, "SELECT id, host, port FROM vehicles")
    try:
        config = json.loads(sessions[0]["config"])
    except RecursionError:
        raise ConfigError(f"{audit}: its newest configuration is nested too deeply") from None
    return config, {row["id"]: (row["host"], row["port"]) for row in vehicles if row["host"]}


def links_of(raw: Mapping[str, Any], source: str) -> list[KillLink]:
    """The links of a configuration. Raises: ConfigError."""
    try:
        return [_link(each) for each in raw["links"]]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"{source}: its links cannot be read: {error!r}") from None


def _link(raw: Mapping[str, Any]) -> KillLink:
    listen, signing = raw["listen"], raw.get("signing") or {}
    urls = [listen] if isinstance(listen, str) else [str(each) for each in listen]
    key_file = Path(signing["key_file"]) if signing else None
    return KillLink(
        raw["name"],
        urls,
        int(raw.get("ports", 1)),
        _system_ids(raw["name"], raw["vehicles"]),
        raw.get("transport", "mavsdk"),
        key_file,
        int(signing.get("link_id", 0)),
    )


def _system_ids(link: str, vehicles: Any) -> dict[str, int]:
    if not isinstance(vehicles, Mapping):
        return {str(each["id"]): int(each["system_id"]) for each in vehicles}
    first, pattern = int(vehicles.get("first_system_id", 1)), vehicles.get("id_pattern", "d{system_id}")
    ids = range(first, first + int(vehicles["count"]))
    named = pattern.replace("{link}", link)
    return {named.replace("{system_id}", str(number)): number for number in ids}


def _rows(audit: Path, sql: str, *values: float) -> list[sqlite3.Row]:
    """Raises: sqlite3.Error."""
    with closing(sqlite3.connect(f"{audit.resolve().as_uri()}?mode=ro", uri=True, timeout=BUSY_S)) as opened:
        opened.row_factory = sqlite3.Row
        return opened.execute(sql, values).fetchall()
