"""The garbage collector runs between ticks, and never in one."""

import gc
import weakref

from gcs.flight.state.ticker import FULL_S, garbage_between_ticks


class Knot:
    """Refers to itself: only the garbage collector frees it."""

    def __init__(self) -> None:
        self.itself = self


def test_cycles_made_in_a_tick_are_freed_after_it_and_not_before() -> None:
    gc.enable()  # a flight that another test has led somewhere, and that stands still, keeps it disabled
    with garbage_between_ticks() as collect:
        collect(0.0)
        knots = [weakref.ref(Knot()) for _ in range(gc.get_threshold()[0] * 2)]
        assert all(knot() is not None for knot in knots)
        collect(0.05)
        assert all(knot() is None for knot in knots)
    assert gc.isenabled()


def test_old_cycles_are_freed_once_a_minute() -> None:
    with garbage_between_ticks() as collect:
        collect(0.0)
        knot = Knot()
        gc.collect(1)  # it is old now
        old = weakref.ref(knot)
        del knot
        collect(0.05)
        assert old() is not None
        collect(FULL_S)
        assert old() is None
