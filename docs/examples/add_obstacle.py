"""Add an obstacle, list all obstacles, and remove it. Argument: URL of the service."""

import sys

from gcs.client import Client

with Client(*sys.argv[1:]) as client:
    tower = client.add_obstacle(x_m=60, y_m=0, half_length_x_m=3, half_length_y_m=3, height_m=40)
    for each in client.obstacles():
        print(each.id, "at", each.x_m, each.y_m, "m,", each.height_m, "m high")
    client.remove_obstacle(tower.id)
