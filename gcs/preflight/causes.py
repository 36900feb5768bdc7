"""What to mend first: a failure that follows from another one is folded under it. Pure.

Which failures about several vehicles follow from one vehicle is evaluated: without it they are gone.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Final, TypeAlias

from gcs.model.preflight_report import (
    READY,
    Check,
    PreflightAction,
    PreflightCause,
    PreflightReport,
    Remedy,
    describe,
    named,
)
from gcs.model.state import VehicleId

Finding: TypeAlias = tuple[VehicleId | None, Check]
"""A check that fails, of a vehicle or (None) of the fleet."""

Related: TypeAlias = Callable[[frozenset[VehicleId]], Sequence[Finding]]
"""The findings about several vehicles, or about the fleet, if these vehicles are left out."""

Mended: TypeAlias = Callable[[str, frozenset[VehicleId]], PreflightAction | None]
"""What mends a check of the fleet without leaving vehicles out, once these are left out; None: nothing."""

STEPS_MAX = 6
SUSPECTS_MAX = 3
"""At most so many vehicles are left out one after the other to find what the rest follows from, and each is
the best of so many.
"""

ALONE: Final = frozenset({"place", "height of the pad"})
"""Checks against the others that each concern one vehicle alone."""

RECEIVED, STANDBY, DOWN = "received", "standby", "seen on the ground"
"""A vehicle that fails one of these has no other cause: `PHASE_CHECKS`."""

PHASE_CHECKS: Final = frozenset({RECEIVED, STANDBY, DOWN})

FOLLOWS_MAX: Final = 12
"""Up to so many consequences are described in a refusal."""

NAMED_FEW: Final = 3
"""Of more vehicles a text has the number."""

WAIT: Final = "wait"
"""What is to be done where the answer is on its way: nothing, and no vehicle is left out for it."""


@dataclass(slots=True)
class _Block:
    """One cause while it is found: the check of each of its vehicles, and what follows from it."""

    check: Check
    of: dict[VehicleId, Check] = field(default_factory=dict)
    too: list[VehicleId] = field(default_factory=list)  # to be left out with them
    follows: list[Finding] = field(default_factory=list)

    @property
    def size(self) -> int:
        """How many checks fail with it."""
        return max(1, len(self.of)) + len(self.follows)

    @property
    def out(self) -> frozenset[VehicleId]:
        return frozenset([*self.of, *self.too])


class _Cached:
    """The findings about several vehicles, each question evaluated once."""

    def __init__(self, related: Related, evaluations_max: int) -> None:
        self._related, self._left = related, evaluations_max
        self._known: dict[frozenset[VehicleId], Sequence[Finding]] = {}

    def __call__(self, out: frozenset[VehicleId]) -> Sequence[Finding] | None:
        """None: too many questions, a fleet this large is not evaluated as often."""
        if out not in self._known:
            if self._left <= 0:
                return None
            self._left -= 1
            self._known[out] = self._related(out)
        return self._known[out]


def causes_of(
    own: Mapping[VehicleId, Sequence[Check]],
    related: Related,
    mended: Mended,
    evaluations_max: int,
) -> tuple[PreflightCause, ...]:
    """Fold what fails before a start into its causes, what helps most first.

    Args:
        own: of each vehicle that is to fly, the checks of its own that fail.
        related: see `Related`.
        mended: see `Mended`.
        evaluations_max: how often `related` may be called: it is expensive for large fleets.
    """
    ask = _Cached(related, evaluations_max)
    everything = list(ask(frozenset()) or ())
    blocks = _of_vehicles(own, everything)
    out = frozenset(name for block in blocks for name in block.of)
    own_too = {key for block in blocks for key in map(_key, block.follows)}
    own_too |= {(name, check.name) for block in blocks for name, check in block.of.items()}
    others = [each for each in everything if _key(each) not in own_too]
    left = others if not out else [each for each in ask(out) or () if _key(each) not in own_too]
    _attribute(blocks, _without(others, left), left, out, ask)
    left, out = _beside(blocks, left, out, ask)
    found, left = _suspected(left, out, frozenset(own), ask)
    out |= {name for block in found for name in block.of}
    blocks = sorted([*blocks, *found], key=lambda block: -block.size) + _of_the_fleet(left, frozenset(own))
    return tuple(_cause(block, blocks, own, ask, mended, out) for block in blocks)


def in_words(report: PreflightReport) -> str:
    """Why a start is refused: each cause and what to do about it, then what follows; several are numbered.

    Of many consequences only the checks are named; a vehicle that is absent has none.
    """
    failing: dict[tuple[VehicleId | None, str], list[Finding]] = {}
    of_vehicles = [
        (vehicle.id, check) for vehicle in report.vehicles if vehicle.flies for check in vehicle.failed
    ]
    for finding in (*of_vehicles, *((None, check) for check in report.fleet if not check.passes)):
        failing.setdefault(_key(finding), []).append(finding)
    absent = {name for name, check_name in failing if check_name in PHASE_CHECKS}
    roots: list[str] = []
    for cause in report.causes:
        whole = Check(cause.check, cause.state, problem=cause.text, to_do=cause.to_do)
        own = [failing.pop((name, cause.check), []) for name in (*cause.vehicles, None)]
        roots.append(describe([*chain(*own)] or [(None, whole)]))
    rest = [finding for finding in chain(*failing.values()) if finding[0] not in absent]
    follows = describe(rest)
    if len({check.problem for _, check in rest}) > FOLLOWS_MAX:
        follows = ", ".join(dict.fromkeys(text for cause in report.causes for text in cause.follows))
    causes = [f"{number}. {text}" for number, text in enumerate(roots, 1)] if len(roots) > 1 else roots
    return "; ".join([*causes, *([f"follows: {follows}"] if follows else [])])


def _key(finding: Finding) -> tuple[VehicleId | None, str]:
    return finding[0], finding[1].name


def _without(findings: Iterable[Finding], left: Iterable[Finding]) -> list[Finding]:
    stays = set(map(_key, left))
    return [each for each in findings if _key(each) not in stays]


def _of_vehicles(own: Mapping[VehicleId, Sequence[Check]], everything: Sequence[Finding]) -> list[_Block]:
    """Checks of single vehicles: each has its root, and the same root of several is one block."""
    fails = {name: list(checks) for name, checks in own.items() if checks}
    for name, check in everything:
        if name is not None and check.name in ALONE:
            fails.setdefault(name, []).append(check)
    of_fleet = {check.name for name, check in everything if name is None}
    blocks: dict[object, _Block] = {}
    for name, checks in fails.items():
        if all(of_fleet.intersection(check.depends_on) for check in checks):
            continue  # the pattern of all is wrong, not its place
        roots = {check.name: _root(check, checks) for check in checks}
        for check in checks:
            root = roots[check.name]
            block = blocks.setdefault(_alike(root), _Block(root))
            if check.name == root.name:
                block.of.setdefault(name, check)
            else:
                block.follows.append((name, check))
    return list(blocks.values())


def _alike(check: Check) -> object:
    """What is the same for vehicles with one cause: values with a unit may differ."""
    says = check.to_do if check.unit else check.problem
    return check.name, check.state, says


def _root(check: Check, checks: Sequence[Check]) -> Check:
    """The check of the same vehicle from which this one follows; itself where it follows from none."""
    known = {each.name: each for each in checks}
    phase = next((known[name] for name in PHASE_CHECKS if name in known), None)
    if phase is not None:
        return phase
    root, seen = known[check.name], {check.name}
    while above := [name for name in root.depends_on if name in known and name not in seen]:
        seen.add(above[0])
        root = known[above[0]]
    return root


def _attribute(
    blocks: Sequence[_Block],
    gone: Sequence[Finding],
    left: Sequence[Finding],
    out: frozenset[VehicleId],
    ask: _Cached,
) -> None:
    """Fold each finding that is gone without the vehicles in `out` under the block that suffices for it."""
    rest = list(gone)
    for block in sorted(blocks, key=lambda block: -len(block.of)) if len(blocks) > 1 else ():
        if not rest:
            return
        alone = ask(out - block.out)
        if alone is not None:
            mine = _without(rest, _without(rest, [each for each in alone if each not in left]))
            block.follows += mine
            rest = _without(rest, mine)
    if rest:
        max(blocks, key=lambda block: len(block.of)).follows += rest


def _beside(
    blocks: Sequence[_Block], left: list[Finding], out: frozenset[VehicleId], ask: _Cached
) -> tuple[list[Finding], frozenset[VehicleId]]:
    """Leave out those that stand too near to a vehicle that is left out: it stays where it is."""
    block_of = {name: block for block in blocks for name in block.of}
    more = set[VehicleId]()
    for name, check in left:
        by = next((block_of[each] for each in check.depends_on if each in block_of), None)
        if name is not None and by is not None and name not in more:
            by.too.append(name)
            by.follows.append((name, check))
            more.add(name)
    if not more:
        return left, out
    without = ask(out | more)
    rest = [each for each in left if each[0] not in more] if without is None else list(without)
    return rest, out | more


def _suspected(
    left: list[Finding], out: frozenset[VehicleId], ids: frozenset[VehicleId], ask: _Cached
) -> tuple[list[_Block], list[Finding]]:
    """Leave out one vehicle after the other while that explains all of what is left; else none.

    A vehicle explains also what fails because of it and is not gone without it: it stays where it stands. Of
    two that explain as much neither is blamed.
    """
    found: dict[object, _Block] = {}
    rest = left
    for _ in range(STEPS_MAX):
        if not rest:
            break
        explained: list[tuple[int, VehicleId, list[Finding]]] = []
        for name in _suspects(rest, out, ids):
            if (without := ask(out | {name})) is not None:
                still = [each for each in without if not _because_of(name, each)]
                explained.append((len(still), name, still))
        explained.sort(key=lambda each: each[0])
        if not explained or explained[0][0] >= len(rest) or explained[0][0] in [n for n, *_ in explained[1:]]:
            break
        _, name, without = explained[0]
        gone = _without(rest, without)
        first = next((each for each in gone if each[0] == name), gone[0])
        check = first[1] if first[0] in {name, None} else _of_another(*first)
        block = found.setdefault(check.name, _Block(check))
        block.of[name] = check
        block.follows += [each for each in gone if each is not first or check is not first[1]]
        stays = {each[0] for each in ask(out | {name}) or () if _because_of(name, each)}
        block.too += [owner for owner in ids if owner in stays]
        out, rest = out | {name, *block.too}, without
    return ([], left) if rest else (list(found.values()), [])


def _because_of(name: VehicleId, finding: Finding) -> bool:
    """Whether another vehicle fails a check because of this one."""
    return finding[0] is not None and name in finding[1].depends_on


def _of_another(owner: VehicleId | None, check: Check) -> Check:
    """The check, said of the vehicle because of which `owner` fails it."""
    return replace(check, problem=f"{owner} {check.problem}")


def _suspects(
    findings: Sequence[Finding], out: frozenset[VehicleId], ids: frozenset[VehicleId]
) -> list[VehicleId]:
    """The vehicles that most findings are about, the most first."""
    votes = Counter(
        name
        for owner, check in findings
        for name in dict.fromkeys([owner, *check.depends_on])
        if name in ids - out and name
    )
    return [name for name, _ in votes.most_common(SUSPECTS_MAX)]


def _of_the_fleet(left: Sequence[Finding], ids: frozenset[VehicleId]) -> list[_Block]:
    """What no vehicle alone explains: one block for each check, with the vehicles that it is about."""
    blocks: dict[str, _Block] = {}
    for name, check in left:
        block = blocks.setdefault(check.name, _Block(check))
        if name is not None:
            block.of.setdefault(name, check)
            for other in ids.intersection(check.depends_on) - {name}:
                block.of.setdefault(other, _of_another(name, check))
    for name, block in list(blocks.items()):
        above = next((blocks[each] for each in block.check.depends_on if each in blocks), None)
        if above is not None:
            above.follows += [*(block.of.items() or [(None, block.check)]), *block.follows]
            del blocks[name]
    found: list[_Block] = []
    for block in blocks.values():
        same = next((each for each in found if each.of and each.of.keys() == block.of.keys()), None)
        if same is None:
            found.append(block)
        else:
            same.follows += block.of.items()
    return found


def _cause(
    block: _Block,
    blocks: Sequence[_Block],
    own: Mapping[VehicleId, Sequence[Check]],
    ask: _Cached,
    mended: Mended,
    out: frozenset[VehicleId],
) -> PreflightCause:
    action = mended(block.check.name, out) if not block.of or block.of.keys() - out else None
    if action is not None:
        action = replace(action, then=_then(len(blocks) - 1))
    elif block.of and block.check.to_do != WAIT and block.check.name != STANDBY:
        action = _vehicles_out(block, blocks, own, ask)
    return PreflightCause(
        check=block.check.name,
        state=block.check.state,
        text=_text(block),
        to_do=block.check.to_do,
        vehicles=tuple(block.of),
        follows=tuple(_folded(block.follows)),
        action=action,
    )


def _vehicles_out(
    block: _Block, blocks: Sequence[_Block], own: Mapping[VehicleId, Sequence[Check]], ask: _Cached
) -> PreflightAction | None:
    """Leave the block's vehicles out; None where no other would fly."""
    vehicles = tuple(name for name in own if name in block.out)
    some = _some([name for name in vehicles if name in block.of])
    if block.check.name == DOWN:
        return PreflightAction(Remedy.CONFIRM_DOWN, f"Confirm {some} down", "", vehicles)
    if len(vehicles) == len(own):
        return None
    left = ask(block.out)
    fails = left is None or len(left) or any(own[name] for name in own.keys() - block.out)
    others = [each for each in blocks if each is not block and not (each.of and each.of.keys() <= block.out)]
    then = "" if left is None else _then(max(len(others), 1) if fails else 0)
    beside = _some([name for name in vehicles if name not in block.of])
    label = f"Leave {some} out, with {beside} beside" if beside else f"Leave {some} out"
    return PreflightAction(Remedy.LEAVE_OUT, label, then, vehicles)


def _some(vehicles: Sequence[VehicleId]) -> str:
    return named(vehicles) if len(vehicles) <= NAMED_FEW else f"{len(vehicles)} vehicles"


def _then(others: int) -> str:
    remain = "1 other cause remains" if others == 1 else f"{others} other causes remain"
    return remain if others else READY


def _text(block: _Block) -> str:
    check, checks = block.check, list(block.of.values())
    if not checks:
        return check.problem
    some = _some(list(block.of))
    if len({each.problem for each in checks}) == 1:
        return f"{some}: {check.problem}"
    values = sorted(each.value for each in checks if each.value is not None)
    found = [_worded(value, check.unit) for value in (values[:1] + values[-1:])]
    measured = " to ".join(dict.fromkeys(found))
    return f"{some}: {' '.join(filter(None, (check.name, measured)))}, {check.limit}"


def _worded(value: float, unit: str) -> str:
    return f"{value:.0%}" if unit == "of 1" else f"{value:.1f} {unit}".strip()


def _folded(findings: Iterable[Finding]) -> Iterable[str]:
    by_name: dict[str, list[VehicleId]] = {}
    for name, check in findings:
        vehicles = by_name.setdefault(check.name, [])
        if name is not None and name not in vehicles:
            vehicles.append(name)
    for check_name, vehicles in by_name.items():
        yield f"{check_name}: {named(vehicles)}" if vehicles else check_name
