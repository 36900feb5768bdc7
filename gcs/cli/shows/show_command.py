"""`gcs show`: finds the module of an action. Import and samples of a drawing load no simulation."""

import argparse
from typing import Final

from gcs.cli.main import load

ACTIONS: Final = {
    "check": ("simulate", "check_show"),
    "hash": ("simulate", "hash_show"),
    "plot": ("simulate", "plot_show"),
    "import": ("shows.drawn_shows", "import_show"),
    "sample": ("shows.drawn_shows", "sample_show"),
    "place": ("shows.place_show", "place_show"),
    "export": ("shows.show_export", "export_show"),
}


def run_show(arguments: argparse.Namespace) -> int:
    """Run the action. Returns: 0; 1 when the show fails its check. Raises: ConfigError for a bad file."""
    return int(load(*ACTIONS[arguments.action])(arguments))
