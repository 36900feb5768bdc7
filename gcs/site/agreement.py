"""What all stations of a site have to have in common before a start. Pure."""

from collections.abc import Mapping
from typing import Final

from gcs.config.schema import Config
from gcs.preflight.go import changes, digest

NAMES_MAX: Final = 16
"""Of what another station reports."""


def rules_of(config: Config) -> dict[str, str]:
    """Digest of each, by the name that it has in a refusal.

    The fence is that of the configuration: what a site makes of it follows from the site and the show frame.
    """
    site, go = config.flight_site, config.go
    fence = config.fence_without_site or config.control.safety.fence
    return {
        "site": "none" if site is None else digest(site.digest),
        "control.safety.fence": digest(fence.model_dump(mode="json")),
        "show_frame": digest(config.show_frame.model_dump(mode="json")),
        "go.confirmed_by_another": digest(go is not None and go.confirmed_by_another),
    }


def why_others(own: Mapping[str, str], their: Mapping[str, str]) -> str:
    """How another station differs from this one, and what to do, in words; empty: it does not."""
    what = changes(own, their)
    to_do = "give both the same configuration and site file, and start them again"
    return f"it differs from this station in {what}: {to_do}" if what else ""
