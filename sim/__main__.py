"""`python -m gcs.sim`: a fake fleet without a ground station."""

import sys

from gcs.sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
