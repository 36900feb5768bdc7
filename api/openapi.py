"""Prints the OpenAPI document, as at `/openapi.json`, without a service: `python -m gcs.api.openapi`.

The console's types (`api/console/src/schemas/schema.ts`) are generated from it.
"""

import json
import sys

from gcs.api.app import routed


def text() -> str:
    """Return the OpenAPI document as JSON, always in the same order."""
    return json.dumps(routed().openapi(), indent=1, sort_keys=True) + "\n"


if __name__ == "__main__":
    sys.stdout.write(text())
