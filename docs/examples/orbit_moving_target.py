"""Let the formation orbit a target that moves east at 0.5 m/s. Argument: URL of the service."""

import sys
import time

from gcs.client import Client

with Client(*sys.argv[1:]) as client:
    client.change_orbit(radius_m=10, speed_m_s=2, direction="clockwise")
    client.set_target(6, 4, velocity_y_m_s=0.5)
    for _ in range(3):
        time.sleep(1)
        target = client.target()
        print(f"target at x {target.x_m:.1f} m, y {target.y_m:.1f} m")
