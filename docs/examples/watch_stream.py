"""Print the state of the fleet twice a second, five times. Argument: URL of the service."""

import json
import sys
from itertools import islice

from websockets.sync.client import connect

url = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000"
with connect(url.replace("http", "ws", 1) + "/api/v1/stream?rate_hz=2", max_size=None) as stream:
    for message in islice(stream, 5):
        fleet = json.loads(message)
        print(fleet["show"]["phase"], {each["id"]: each["phase"] for each in fleet["vehicles"]})
