"""Start all vehicles that are ready, wait for the formation, and enlarge it. Argument: URL of the service."""

import sys

from gcs.client import Client

with Client(*sys.argv[1:]) as client:
    ready = [vehicle.id for vehicle in client.vehicles() if vehicle.ready]
    order = client.wait_for(client.start(ready).id, timeout_s=120)
    print(order.action, order.outcome, *order.outcomes)
    formation = client.change_formation(radius_m=14)
    print("radius now", formation.radius_now_m, "m, on the way to", formation.radius_m, "m")
