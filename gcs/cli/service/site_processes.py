"""`gcs serve --all`: every station of a site as a process of its own on this machine.

This process only starts them, passes signals on, and waits. Stations have sessions of their own, so that each
receives Ctrl-C only once, from here. They write their own lines, and outlive this process.
"""

import argparse
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Final

from gcs.cli.outlet import Outlet
from gcs.cli.output import noted
from gcs.cli.service.process import Notifier
from gcs.cli.service.supervisor import ALL, pass_on

LOOK_S: Final = 0.05


def run(names: Sequence[str], words: Sequence[str], arguments: argparse.Namespace, notifier: Notifier) -> int:
    """Run `gcs WORDS --station NAME` for every name until all have ended.

    Returns: 0, or the exit code of the first in the list that failed.
    """
    stop_requests: list[int] = []
    pass_on(stop_requests)
    outlet = Outlet(sys.stderr, lambda count: noted(f"{count} lines dropped", as_json=arguments.json))
    command = [sys.executable, "-m", "gcs", *(word for word in words if word != ALL)]
    children = {
        name: subprocess.Popen([*command, "--station", name], start_new_session=True)  # noqa: S603 (this program)
        for name in names
    }
    notifier.ready()
    codes: dict[str, int] = {}
    passed_on = 0
    while len(codes) < len(children):
        for name, child in children.items():
            if name not in codes and child.poll() is not None:
                codes[name] = _code(child.returncode, stopped=passed_on > 0)
                if not passed_on:
                    rest = len(children) - len(codes)
                    go_on = f"; {rest} of {len(children)} stations go on" if rest else ""
                    text = f"{name} ended with exit code {codes[name]}{go_on}"
                    outlet.write(noted(text, as_json=arguments.json))
        for number in stop_requests[passed_on:]:
            if not passed_on:
                notifier.stopping()
            passed_on += 1
            for name in children.keys() - codes.keys():
                children[name].send_signal(number)
        notifier.beat()
        time.sleep(LOOK_S)
    return next((codes[name] for name in names if codes[name]), 0)


def _code(returned: int, *, stopped: bool) -> int:
    """Exit code as a shell reports it; a station that was stopped before it could listen ended well."""
    if stopped and returned in {-signal.SIGTERM, -signal.SIGHUP}:
        return 0
    return returned if returned >= 0 else 128 - returned
