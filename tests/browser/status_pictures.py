"""Pictures of `gcs status` at 80 and 120 columns, for docs/screenshots: `make screenshots`. Look at them."""

from io import StringIO
from pathlib import Path
from typing import Final

from rich.console import Console

from gcs.cli.status import board
from tests.support.status_example import example_fleet

FOLDER: Final = Path(__file__).parents[2] / "docs" / "screenshots"


def main() -> None:
    """Draw both."""
    fleet = example_fleet()
    for width in (80, 120):
        console = Console(width=width, record=True, file=StringIO(), force_terminal=True)
        console.print(board(fleet, width))
        console.save_svg(str(FOLDER / f"status-{width}.svg"), title=f"gcs status, {width} columns")


if __name__ == "__main__":
    main()
