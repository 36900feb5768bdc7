"""Which station leads. A new lead is made by an operator, never by a vote of programs."""

from collections.abc import Sequence


class SiteLead:
    """The lead that one station obeys: of the highest term, and within a term of the last name.

    The first station of the site leads term 1, which needs no command.
    """

    def __init__(self, own: str, stations: Sequence[str]) -> None:
        """`stations`: all names in the site's order."""
        self._own, self._stations = own, tuple(stations)
        self.term, self.name = 1, self._stations[0]

    @property
    def leads(self) -> bool:
        """Whether this station leads."""
        return self.name == self._own

    @property
    def number(self) -> int:
        """Place of the lead among the site's stations."""
        return self._stations.index(self.name)

    def observe(self, term: int, station: int) -> bool:
        """Note which lead another station obeys. Returns: whether this station obeys another one now."""
        if station >= len(self._stations):
            return False
        name = self._stations[station]
        if term == 1 and station != 0:  # term 1 needs no command: it is the first station's
            return False
        if (term, name) <= (self.term, self.name):
            return False
        self.term, self.name = term, name
        return True

    def obeys(self, term: int, station: int) -> bool:
        """Whether a message of the lead of this term is obeyed."""
        return (term, station) == (self.term, self.number)

    def take(self) -> int:
        """Lead from now on, on an operator's command. Returns: the new term."""
        if not self.leads:
            self.term, self.name = self.term + 1, self._own
        return self.term
