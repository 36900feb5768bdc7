"""Read the flight data of one session, cell by cell as in a notebook. Argument: path of flight.mcap."""

# %% All ticks of the flight: messages are JSON (docs/records.md)
import json
import sys
from pathlib import Path

from mcap.reader import make_reader

with Path(sys.argv[1]).open("rb") as file:
    ticks = [json.loads(each.data) for _, _, each in make_reader(file).iter_messages(["/fleet/tick"])]

# %% How long, how large, how close
apart_m = [each["minimum_separation_m"] for each in ticks if each["minimum_separation_m"] is not None]
print(f"{len(ticks)} ticks in {ticks[-1]['time_s'] - ticks[0]['time_s']:.1f} s")
print(f"largest radius: {max(each['radius_m'] or 0 for each in ticks):.1f} m")
print(f"closest pair: {min(apart_m):.2f} m")
