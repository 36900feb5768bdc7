"""The command `gcs`: the composition root, where control, API and fake fleet meet."""

from gcs.cli.main import main

__all__ = ["main"]
