"""Checklists: what a file may hold, what signatures close, and what opens items again."""

from pathlib import Path

import pytest

from gcs.model.errors import ConfigError, InvalidError, UnknownError
from gcs.preflight.checklists import (
    ITEMS_MAX,
    ROLES_MAX,
    TEXT_MAX,
    Checklists,
    SignedFor,
    parse_checklists,
    read_checklists,
)

TEXT = """
pilot:
  - the transmitter takes over each vehicle
  - {text: the way to the pads is clear, kept_over: [show, parameters]}
pads:
  - {text: each vehicle stands on its pad, kept_over: [parameters]}
"""
SEEN = SignedFor("s1", {"d1": "p1"})


def signed() -> Checklists:
    lists = parse_checklists(TEXT, "lists.yaml")
    lists.note(SEEN)
    lists.sign("pilot", [1, 2], "alice", 1.0)
    lists.sign("pads", [1], "bob", 2.0)
    assert open_items(lists) == {"pilot": (), "pads": ()}
    return lists


def open_items(lists: Checklists) -> dict[str, tuple[int, ...]]:
    return {each.role: each.open for each in lists.view()}


def test_open_items_fail_and_signed_ones_have_name_and_time() -> None:
    lists = parse_checklists(TEXT, "lists.yaml")
    problems = {check.name: check.problem for check in lists.checks()}
    assert problems["checklist pilot"] == (
        "checklist pilot: 2 of 2 items are open: (1) the transmitter takes over each vehicle;"
        " (2) the way to the pads is clear"
    )
    assert all(check.passes for check in signed().checks())
    item = signed().view()[1].items[0]
    assert (item.by, item.unix_time_s) == ("bob", 2.0)


@pytest.mark.parametrize(
    ("seen", "pilot", "pads"),
    [
        (SEEN, (), ()),
        (SignedFor("s2", {"d1": "p1"}), (1,), (1,)),
        (SignedFor("", {"d1": "p1"}), (1,), (1,)),
        (SignedFor("s1", {"d1": "p9"}), (1,), ()),
        (SignedFor("s1", {"d1": "p1", "d2": "p2"}), (), ()),  # switched on since
        (SignedFor("s1", {}), (), ()),  # silent for a while
    ],
)
def test_what_changes_opens_what_depends_on_it(
    seen: SignedFor, pilot: tuple[int, ...], pads: tuple[int, ...]
) -> None:
    lists = signed()
    assert lists.note(seen) == len(pilot) + len(pads)
    assert open_items(lists) == {"pilot": pilot, "pads": pads}


def test_parameters_that_differ_after_a_silence_open_items() -> None:
    lists = signed()
    lists.note(SignedFor("s1", {}))
    lists.note(SignedFor("s1", {"d1": "p9"}))
    assert open_items(lists) == {"pilot": (1,), "pads": ()}


def test_a_landing_opens_every_item() -> None:
    lists = signed()
    assert lists.note_landing() == 3
    assert open_items(lists) == {"pilot": (1, 2), "pads": (1,)}


def test_a_signature_is_taken_back() -> None:
    lists = signed()
    lists.reopen("pilot", [2])
    assert open_items(lists) == {"pilot": (2,), "pads": ()}


def test_unknown_roles_and_numbers_are_refused_and_sign_nothing() -> None:
    lists = parse_checklists(TEXT, "lists.yaml")
    with pytest.raises(UnknownError, match="there is no checklist 'crew'; there are pilot, pads"):
        lists.sign("crew", [1], "alice", 1.0)
    for numbers in ([1, 3], [0], []):
        with pytest.raises(InvalidError):
            lists.sign("pilot", numbers, "alice", 1.0)
    assert open_items(lists) == {"pilot": (1, 2), "pads": (1,)}


BAD = {
    "empty": ("", "lists.yaml"),
    "no list": ("pilot: look", "lists.yaml: line 1: pilot"),
    "no items": ("pilot: []", "lists.yaml: line 1: pilot"),
    "capitals": ("Pilot: [look]", "lists.yaml: line 1: Pilot"),
    "blank": ("pilot: ['  ']", "lists.yaml: line 1: pilot.0"),
    "long": (f"pilot: [{'x' * (TEXT_MAX + 1)}]", "lists.yaml: line 1: pilot.0"),
    "many": (f"pilot: [{', '.join(['look'] * (ITEMS_MAX + 1))}]", "lists.yaml: line 1: pilot"),
    "roles": ("".join(f"r{row}: [look]\n" for row in range(ROLES_MAX + 1)), "lists.yaml"),
    "key": ("pilot: [{text: look, keeps: [show]}]", "lists.yaml: line 1: pilot.0.keeps"),
    "kind": ("pilot: [{text: look, kept_over: [landing]}]", "lists.yaml: line 1: pilot.0.kept_over.0"),
    "twice": ("pilot: [look]\npilot: [look]", "lists.yaml: line 2"),
    "number": ("pilot: [7]", "lists.yaml: line 1: pilot.0"),
}


@pytest.mark.parametrize("why", BAD)
def test_a_bad_file_is_refused_with_its_line(why: str) -> None:
    text, says = BAD[why]
    with pytest.raises(ConfigError, match=says):
        parse_checklists(text, "lists.yaml")


def test_a_file_that_is_absent_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"lists\.yaml"):
        read_checklists(tmp_path / "lists.yaml")
    assert read_checklists(None).view() == ()
