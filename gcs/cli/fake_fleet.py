"""`gcs sim`: runs only the fake fleet. `python -m gcs.sim` does the same, without `--json`."""

import argparse
import json

from gcs.cli.output import fail
from gcs.sim import cli as sim


def run(arguments: argparse.Namespace) -> int:
    """Run until interrupted. Returns: exit code 0, 1 for a port or file in use, 2 for bad arguments."""
    try:
        text = sim.greeting(arguments)
        if arguments.json:
            ports = sorted(set(sim.destinations(arguments)))
            text = json.dumps({"event": "flying", "text": text, "vehicles": arguments.count, "ports": ports})
        sim.fly(arguments, text)
    except sim.FleetError as error:
        fail(str(error), error.code, as_json=arguments.json)
        return error.code
    return 0
