"""A start by two: proposed by one token, confirmed by another for the same hash, in time. Pure."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import Final

from gcs.model.errors import RefusedError

HASH_DIGITS: Final = 12
"""Of SHA-256 in hexadecimal: short enough to be read out over a radio."""


def digest(value: object) -> str:
    """First digits of SHA-256 of a value as JSON."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return sha256(text.encode()).hexdigest()[:HASH_DIGITS]


def go_hash(parts: Mapping[str, str]) -> str:
    """Hash of all parts by name; an empty part is as one that is not there."""
    return digest({name: value for name, value in parts.items() if value})


def changes(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Names of the parts that differ, in words; empty: none does."""
    names = [name for name in {**before, **now} if before.get(name, "") != now.get(name, "")]
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


@dataclass(frozen=True, slots=True)
class Proposal:
    """A start that waits for another token."""

    by: str
    parts: Mapping[str, str]  # digests by name
    until_s: float

    @property
    def hash(self) -> str:
        return go_hash(self.parts)

    def why_over(self, parts: Mapping[str, str], now_s: float, within_s: float) -> str:
        """Why it cannot be confirmed any more, in words; empty: it can."""
        if not now_s <= self.until_s:  # written so that NaN ends it
            return f"no other token confirmed it within {within_s:g} s"
        if what := changes(self.parts, parts):
            return f"{what} changed since {self.by} proposed it"
        return ""


@dataclass(slots=True)
class GoByTwo:
    """The start that is proposed, if one is. At most one waits."""

    within_s: float
    proposal: Proposal | None = None
    ended: str = ""  # why the newest is over, in words; empty: it waits, was confirmed, or none was

    def propose(
        self, by: str, parts: Mapping[str, str], now_s: float, of_waiting: Mapping[str, str] | None = None
    ) -> Proposal:
        """Propose a start, in place of an own one that waits. Raises: RefusedError while another's waits.

        `of_waiting` are the digests, as they are now, of what waits; None: as `parts`.
        """
        waits, own = self.proposal, parts if of_waiting is None else of_waiting
        if waits is not None and waits.by != by and not waits.why_over(own, now_s, self.within_s):
            raise RefusedError(
                f"{waits.by} has proposed a start, {waits.until_s - now_s:.0f} s are left:"
                f" gcs confirm {waits.hash} confirms it, gcs stop calls it off"
            )
        self.proposal, self.ended = Proposal(by, dict(parts), now_s + self.within_s), ""
        return self.proposal

    def check(self, by: str, given_hash: str, parts: Mapping[str, str], now_s: float) -> Proposal:
        """Return the proposal that this confirms. Raises: RefusedError; nothing is confirmed then."""
        proposal = self.proposal
        if proposal is None:
            why = f": {self.ended}" if self.ended else ""
            raise RefusedError(f"no start is proposed{why}; gcs start proposes one")
        if why := self.look(parts, now_s):
            raise RefusedError(f"the start is over: {why}; propose it again")
        if by == proposal.by:
            raise RefusedError(f"{by} proposed this start: another token confirms it")
        if given_hash != proposal.hash:
            raise RefusedError(
                f"the start of {proposal.by} has the hash {proposal.hash}, not {given_hash[:64]!r}:"
                " look at what is proposed, and confirm that"
            )
        return proposal

    def take(self) -> None:
        """Note that the proposal was confirmed: it works once."""
        self.proposal, self.ended = None, ""

    def look(self, parts: Mapping[str, str], now_s: float) -> str:
        """End the proposal if it is over. Returns: why, in words; empty: it waits, or none does."""
        why = "" if self.proposal is None else self.proposal.why_over(parts, now_s, self.within_s)
        if why:
            self.end(why)
        return why

    def end(self, why: str) -> None:
        """End the proposal, if one waits."""
        if self.proposal is not None:
            self.proposal, self.ended = None, why
