"""`python -m gcs.sim`: a fleet alone."""

import sys

from gcs.sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
