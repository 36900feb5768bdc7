"""`python -m gcs` is `gcs`."""

import faulthandler
import sys

from gcs import supervisor


def main() -> int:
    """Entry point. A supervisor is up before anything else is loaded. Returns: the exit code."""
    if supervisor.is_wanted(sys.argv[1:]):
        return supervisor.run(sys.argv[1:])
    faulthandler.enable()  # what hangs and is sent SIGABRT says where
    from gcs import cli  # noqa: PLC0415 (heavy)

    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
