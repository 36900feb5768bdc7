"""In every state of the console, at every size and in every look, axe finds nothing."""

from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from tests.support.console_bench import Console
from tests.support.console_states import STATES, ConsoleState, in_state

pytestmark = pytest.mark.usefixtures("prompt_checks")

PHONE: Final = (360, 640)
DESK: Final = (1280, 800)
OTHERS: Final = ((768, 1024), (1920, 1080), (2560, 1440))
"""From the smallest: a panel that a small window has open stays open in a larger one."""

LAID_OUT_MS: Final = 300


def in_its_state(ui: Console, state: ConsoleState, size: tuple[int, int]) -> None:
    """In a window of that size. What has closed there, or has expired, is opened again."""
    ui.page.set_viewport_size({"width": size[0], "height": size[1]})
    ui.page.wait_for_timeout(LAID_OUT_MS)
    if not ui.part(state.shown).first.is_visible():
        state.act(ui)
    expect(ui.part(state.shown).first).to_be_visible()


def by_day(ui: Console) -> None:
    """Or by night again; a dialog may lie over the button."""
    ui.part("night").dispatch_event("click")


@pytest.mark.soak
@pytest.mark.parametrize("state", STATES, ids=lambda each: each.name)
def test_axe_finds_nothing_on_a_phone_and_on_a_desk(
    chrome: Browser, tmp_path: Path, state: ConsoleState
) -> None:
    with in_state(chrome, state, tmp_path, PHONE) as ui:
        found = {"phone": ui.findings()}
        in_its_state(ui, state, DESK)
        found |= {"desk": ui.findings()}
        by_day(ui)
        found |= {"by day": ui.findings()}
        assert not any(found.values()), found


@pytest.mark.soak
@pytest.mark.parametrize("state", STATES, ids=lambda each: each.name)
def test_axe_finds_nothing_at_other_sizes(chrome: Browser, tmp_path: Path, state: ConsoleState) -> None:
    with in_state(chrome, state, tmp_path, OTHERS[0]) as ui:
        found = {}
        for size in OTHERS:
            in_its_state(ui, state, size)
            found[size] = ui.findings()
        ui.page.emulate_media(forced_colors="active")
        found[0, 0] = ui.findings()
        assert not any(found.values()), found
