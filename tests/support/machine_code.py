"""Compiles every kernel of a flight before tests begin: copies of a process would each compile the same.

python -m tests.support.machine_code
"""

from gcs.flight import composition
from gcs.links import receiver, sender
from gcs.mavlink import codec, reports
from gcs.simulation import Scenario
from gcs.simulation import fly as simulate
from gcs.stations import publishing
from gcs.testing.virtual_show import VirtualShow, fly, show_config


async def stand(show: VirtualShow) -> None:
    """The fake fleet has kernels of its own."""
    await show.standby()


def main() -> None:
    for module in (composition, publishing, codec, reports, sender, receiver):
        module.warm_up()
    fly(stand, show_config(2))
    simulate(Scenario.load("assembly").with_(duration_s=1.0), 2, 1).metrics.figures()


if __name__ == "__main__":
    main()
