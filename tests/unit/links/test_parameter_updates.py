"""What vehicles announce of their parameters is kept bounded."""

from gcs.links.receiver import ParameterUpdates


def test_only_the_newest_watched_values_are_kept() -> None:
    updates = ParameterUpdates(["d1"])
    updates.take(0, "COM_OF_LOSS_T", 1.0)
    updates.watch(["COM_OF_LOSS_T"])
    for value in range(1000):
        updates.take(0, "COM_OF_LOSS_T", float(value))
        updates.take(0, f"OTHER_{value}", 1)
    assert updates.drain() == {"d1": {"COM_OF_LOSS_T": 999.0}}
    assert updates.drain() == {}
