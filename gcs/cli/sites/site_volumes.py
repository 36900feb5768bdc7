"""`gcs site volumes`: both computations, term by term, and what the site has beside them."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gcs.areas.files.site_files import written
from gcs.areas.volumes import Comparison, Extent, Volumes, compared, derived
from gcs.cli.output import answer
from gcs.cli.sites.fleet_kinds import read_parameters, volumes_document, volumes_of, volumes_to_derive
from gcs.cli.sites.site_files import NO_SITE, save
from gcs.config import schema
from gcs.config.schema import Config
from gcs.model.errors import ConfigError

NEARLY_M = 0.01
STAND_IN = "control.safety.impact.airframe is not set: falls and sizes are those of PX4's simulator"


def config_on_site(name: str) -> Config:
    """A configuration that names a site. Raises: ConfigError."""
    path = schema.find(name)
    config = schema.load(path)
    if config.flight_site is None:
        raise ConfigError(f"{path}: {NO_SITE}")
    return config


def site_volumes(arguments: argparse.Namespace) -> int:
    """Print both. Returns: 0; 1 where the site draws less than a computation demands. Raises: ConfigError."""
    config = config_on_site(arguments.config)
    site = config.flight_site
    if site is None:
        raise ConfigError(NO_SITE)
    read = read_parameters(arguments.parameters)
    volumes = volumes_of(config, read)
    beside = compared(site, volumes)
    if arguments.derive is not None:
        target = Path(arguments.derive)
        wider = derived(site, volumes_to_derive(config, site, read))
        save(target, written(wider, target))
    answer(arguments, document(config, volumes, beside), text(config, volumes, beside))
    missing = any(each.spare_m is not None and each.spare_m < -NEARLY_M for each in beside)
    return 1 if missing and arguments.derive is None else 0


def document(config: Config, volumes: Sequence[Volumes], beside: Sequence[Comparison]) -> dict[str, Any]:
    """Both as `--json` has them."""
    site = config.flight_site
    return {
        "site": None if site is None else site.name,
        "hash": None if site is None else site.digest,
        "volumes": [volumes_document(each) for each in volumes],
        "compared": [
            {
                "what": each.what,
                "method": each.method,
                "autopilot": each.autopilot,
                "needed_m": round(each.needed_m, 2),
                "drawn_m": None if each.drawn_m is None else round(each.drawn_m, 2),
                "spare_m": None if each.spare_m is None else round(each.spare_m, 2),
            }
            for each in beside
        ],
    }


def text(config: Config, volumes: Sequence[Volumes], beside: Sequence[Comparison]) -> str:
    """Both as tables for people."""
    site = config.flight_site
    lines = [] if site is None else [f"{site.name}, hash {site.digest}"]
    if config.control.safety.impact.airframe is None:
        lines.append(STAND_IN)
    for each in volumes:
        lines += ["", f"{each.method}, {each.autopilot}:"]
        for extent in each.extents:
            lines += _extent_lines(extent)
    lines += ["", "the site beside them:"]
    return "\n".join([*lines, *map(in_words, beside)])


def _extent_lines(extent: Extent) -> list[str]:
    lines = [f"  {extent.what:<34} {extent.value_m:7.1f} m"]
    lines += [
        f"    {term.name:<32} {term.value_m:7.1f} m  {term.formula} ({term.source})" for term in extent.terms
    ]
    return lines


def in_words(each: Comparison) -> str:
    """One comparison on a line."""
    who = f"{each.what}, {each.method}, {each.autopilot}"
    if each.drawn_m is None or each.spare_m is None:
        return f"  {who}: {each.needed_m:.1f} m needed, not drawn"
    word = "larger" if each.spare_m >= 0.0 else "SMALLER"
    has = f"{each.drawn_m:.1f} m drawn, {abs(each.spare_m):.1f} m {word}"
    return f"  {who}: {each.needed_m:.1f} m needed, {has}"
