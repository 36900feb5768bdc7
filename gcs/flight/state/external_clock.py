"""What a flight needs to know of a clock that is not the station's, and that shows may follow."""

from abc import ABC, abstractmethod

from gcs.flight.state.feature import Feature


class ExternalClock(Feature, ABC):
    """How the selected show stands to it. Every `now_s` is the loop's clock; used on the event loop only."""

    configured: bool
    """Without one, shows run by this station's clock."""

    jump_max_s: float
    """The show follows a jump up to this."""

    catch_up: float
    """Share by which a show may run faster or slower to reach it."""

    def __init__(self) -> None:
        self.followed = self.configured
        self.problem = ""  # why the show waits or stands still
        self.expected = False  # it waits as it should: the clock comes to where the show is
        self.frozen_since_unix_s: float | None = None  # a running show stands still, or comes to rest

    @property
    @abstractmethod
    def slope(self) -> float:
        """How fast it runs."""

    @abstractmethod
    def runs(self, now_s: float) -> bool:
        """Whether the show has a clock to follow."""

    @abstractmethod
    def show_s(self, now_s: float) -> float:
        """The show's time that belongs to it now; NaN: there is none."""

    @abstractmethod
    def note_show(self, show_s: float) -> None:
        """Note the show's time, by which jumps are judged; NaN: it has not begun."""

    @abstractmethod
    def why_not(self, now_s: float) -> str:
        """Why there is nothing to follow, in words; empty while there is."""

    def note_frozen(self, frozen: bool, unix_s: float) -> None:
        """Note whether the running show stands still for want of it, or comes to rest."""
        if not frozen:
            self.frozen_since_unix_s = None
        elif self.frozen_since_unix_s is None:
            self.frozen_since_unix_s = unix_s
