"""The command `gcs`: the composition root, the only package that may import every other."""

from gcs.cli.main import main

__all__ = ["main"]
