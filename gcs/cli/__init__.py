"""The command `gcs`: the composition root, the only package that may import every other."""

import os

# Before numpy is imported. OpenBLAS waits for its threads in a busy loop: with real-time priority, control
# would keep them from running, and stand still for 0.9 s in one product of matrices.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from gcs.cli.main import main

__all__ = ["main"]
