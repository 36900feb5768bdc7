"""`gcs site`: finds the module of an action. Checks and conversions load no simulation."""

import argparse
from typing import Final

from gcs.cli.main import load

ACTIONS: Final = {
    "check": ("sites.site_files", "check_site"),
    "convert": ("sites.site_files", "convert_site"),
    "volumes": ("sites.site_volumes", "site_volumes"),
    "report": ("sites.site_report", "site_report"),
}


def run_site(arguments: argparse.Namespace) -> int:
    """Run the action. Returns: 0; 1 when a site is too small. Raises: ConfigError for a bad file."""
    return int(load(*ACTIONS[arguments.action])(arguments))
