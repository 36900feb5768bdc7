"""What the API says of itself, as `/openapi.json` does, without a service: `python -m gcs.api.openapi`.

The console's types are made of it (`api/console/src/schemas/schema.ts`).
"""

import json
import sys

from gcs.api.app import routed


def text() -> str:
    """OpenAPI as JSON, always in the same order."""
    return json.dumps(routed().openapi(), indent=1, sort_keys=True) + "\n"


if __name__ == "__main__":
    sys.stdout.write(text())
