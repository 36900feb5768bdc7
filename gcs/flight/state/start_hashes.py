"""What a start stands for: hashes of the site, of the show, and of the parameters as they were read. Pure."""

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256

from gcs.areas.site import FlightSite
from gcs.links import ParameterValue
from gcs.model.state import VehicleId


def parameters_hash(
    ids: Sequence[VehicleId], parameters: Mapping[VehicleId, Mapping[str, ParameterValue]]
) -> str:
    """SHA-256, hexadecimal, of the values that these vehicles have; empty where none were read."""
    read = {name: dict(parameters[name]) for name in ids if name in parameters}
    return sha256(json.dumps(read, sort_keys=True).encode()).hexdigest() if read else ""


def start_hashes(
    ids: Sequence[VehicleId],
    site: FlightSite | None,
    show_hash: str | None,
    parameters: Mapping[VehicleId, Mapping[str, ParameterValue]],
) -> dict[str, str]:
    """The hashes by their names in the audit; what there is none of is left out."""
    named = {
        "site_hash": "" if site is None else site.digest,
        "show_hash": show_hash or "",
        "parameters_hash": parameters_hash(ids, parameters),
    }
    return {name: value for name, value in named.items() if value}
