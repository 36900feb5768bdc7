"""`gcs kill`: stops motors, in two steps. The second one is executed by whichever way works first.

The ways are the service, which has the vehicles' links, and this process with the service's record or
configuration. An operator confirms once, and never chooses: a command sent twice does no harm.
"""

import argparse
import getpass
import hashlib
import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, Final

from gcs.cli.output import REFUSED, fail, note, print_json
from gcs.cli.remote import add_connection, exchange
from gcs.client.http import Exchange
from gcs.model.errors import GcsError, InvalidError, LinkError, RefusedError

if TYPE_CHECKING:
    from gcs.cli.kill.plan import KillPlan

RECORD: Final = "runs"
ANSWER_S: Final = 2.0
"""Longest wait for the service in the first step; then the kill goes on without it."""

CONFIRMED_S: Final = 5.0
"""The same in the second step, beside the other way. A service whose control hangs takes 3 s."""

HEAD_START_S: Final = 0.7
"""Time for the service to accept the kill before it is sent without the service as well."""

SERVICE_STOPS_S: Final = 1.5
"""Time for the service to stop all motors, likewise."""

WAIT_S: Final = 6.0
"""Longest wait for motors to stop."""

REPORT_S: Final = 0.5
"""Of that, time to report what was sent."""

LOOK_S: Final = 0.05

CODE_S: Final = 30.0
"""A code is valid for at least this long, and at most twice as long."""

ALL: Final = "--all"


def add_kill_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("vehicles", metavar="VEHICLE", nargs="*")
    parser.add_argument(ALL, action="store_true", help="every vehicle, instead of names")
    parser.add_argument("--confirm", metavar="CODE", help="the second step, without a dialogue")
    parser.add_argument("--direct", action="store_true", help="without the service, though it may answer")
    record = os.environ.get("GCS_RECORD", RECORD)
    parser.add_argument(
        "--record", default=record, metavar="FOLDER", help=f"of the service ({RECORD}; GCS_RECORD)"
    )
    parser.add_argument("--config", metavar="FILE", help="of the service, for a record that cannot be read")
    add_connection(parser)


def run_kill(arguments: argparse.Namespace) -> int:
    """Kill vehicles. Returns: 0 when all motors are off, 1 when not, or when the kill was not confirmed.

    Raises: GcsError when nothing was sent.
    """
    if bool(arguments.vehicles) == arguments.all and arguments.confirm is None:
        raise InvalidError(
            "vehicles", " ".join(arguments.vehicles) or "none", "names, or --all in their place"
        )
    named = [*dict.fromkeys(arguments.vehicles)]
    if arguments.confirm is None:
        names = _known(arguments, named)
        if not is_confirmed(arguments, names, _codes(named)[0]):
            return REFUSED
    elif arguments.confirm not in _codes(named):
        return _confirm_code_of_service(arguments)
    return Kill(arguments, named).run()


def _codes(named: Sequence[str]) -> list[str]:
    """The codes of these vehicles (none: all) that are valid now, the newest first.

    A hash of vehicles and time proves that an operator named them in the first step. Nothing is kept between
    the two steps, so that no process has to answer for the second.
    """
    now_s = time.time()
    slots = [str(int((now_s - age_s) / CODE_S)) for age_s in (0.0, CODE_S)]
    return [
        hashlib.sha256("\0".join(["kill", slot, *(sorted(named) or [ALL])]).encode()).hexdigest()[:6]
        for slot in slots
    ]


def _known(arguments: argparse.Namespace, named: Sequence[str]) -> Sequence[str]:
    """The vehicles of the first step, as the service or else its record knows them. Raises: GcsError."""
    refused: GcsError | None = None
    if not arguments.direct:
        try:
            with closing(exchange(arguments, ANSWER_S)) as client:
                return [str(name) for name in _asked(client, "kill", _body(named))["vehicles"]]
        except GcsError as error:
            note(f"{error}; without the service then", as_json=arguments.json)
            refused = None if isinstance(error, LinkError) else error
    try:
        plan = _plan(arguments)
        names = plan.chosen(named)
    except GcsError as error:
        raise refused or error from None
    note(f"without the service it is sent to {plan.where(names)}", as_json=arguments.json)
    return names


def _plan(arguments: argparse.Namespace) -> "KillPlan":
    from gcs.cli.kill.plan import links_in, plan_of  # noqa: PLC0415 (a call that is only sent needs none of it)

    links = [] if arguments.config is None else links_in(arguments.config)
    return plan_of(Path(arguments.record), links, arguments.config)


def _body(named: Sequence[str]) -> dict[str, Any]:
    return {"vehicles": [*named]} if named else {}


def _asked(client: Exchange, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
    """Call without the API's schemas, whose import takes longer than a kill. Raises: GcsError."""
    answer = client.call("GET" if body is None else "POST", f"/api/v1/{path}", body=body)
    try:
        found: dict[str, Any] = json.loads(answer)
    except ValueError:
        raise LinkError(NOT_OURS) from None
    return found


@dataclass(frozen=True, slots=True)
class KillOutcome:
    """Outcome for one vehicle."""

    done: bool
    reason: str
    way: str  # in words


@dataclass(slots=True)
class Report:
    """What one way has achieved so far."""

    outcomes: Mapping[str, KillOutcome] = field(default_factory=dict)
    accepted: bool = False
    problem: GcsError | None = None  # it ended with this error
    ended: bool = False

    @property
    def done(self) -> bool:
        return bool(self.outcomes) and all(one.done for one in self.outcomes.values())


class Kill:
    """A confirmed kill, by all ways."""

    def __init__(self, arguments: argparse.Namespace, named: Sequence[str]) -> None:
        """`named` is empty for all vehicles."""
        self._arguments = arguments
        self._named = named
        self._began_s, self._began_unix_s = time.monotonic(), time.time()
        self._reports: SimpleQueue[tuple[str, Report]] = SimpleQueue()
        self._service, self._direct = Report(ended=arguments.direct), Report()

    def run(self) -> int:
        """Returns: the exit code. Raises: GcsError when no way could send anything."""
        service = Thread(target=self._through_service, name="kill/service", daemon=True)
        if not self._arguments.direct:
            service.start()
        plan = self._made_plan()
        sent = False
        while not self._is_over():
            if plan is not None and not sent and self._service_is_late():
                sent = True
                Thread(target=self._without_service, args=(plan,), name="kill/direct", daemon=True).start()
            try:
                way, report = self._reports.get(timeout=LOOK_S)
            except Empty:
                continue
            if way == BY_SERVICE:
                self._service = report
            else:
                self._direct = report
        code = describe(self._outcomes(sent=sent), self._arguments)
        if plan is not None and sent and self._direct.ended:
            self._record(plan)
        if service.ident is not None:  # it should know of the kill as well
            service.join(max(0.0, self._began_s + ANSWER_S - time.monotonic()))
        return code

    def _made_plan(self) -> "KillPlan | None":
        """What is known of the vehicles without the service."""
        try:
            plan = _plan(self._arguments)
            names = plan.chosen(self._named)
        except GcsError as error:
            self._direct = Report(problem=error, ended=True)
            return None
        self._direct = Report({name: KillOutcome(False, "not sent yet", DIRECTLY) for name in names})
        return plan

    def _is_over(self) -> bool:
        late = time.monotonic() > self._began_s + WAIT_S
        both = self._service.ended and self._direct.ended
        if both and not (self._service.outcomes or self._direct.outcomes):
            raise self._problem()
        return late or both or self._service.done or (self._direct.done and self._direct.ended)

    def _problem(self) -> GcsError:
        service, direct = self._service.problem, self._direct.problem
        if service is None or direct is None:
            return service or direct or GcsError("nothing was sent")
        note(str(service), as_json=self._arguments.json)
        return direct if isinstance(service, LinkError) else service

    def _service_is_late(self) -> bool:
        if self._service.ended and not self._service.done:
            return True
        return time.monotonic() > self._began_s + (
            SERVICE_STOPS_S if self._service.accepted else HEAD_START_S
        )

    def _through_service(self) -> None:
        try:
            with closing(exchange(self._arguments, CONFIRMED_S)) as client:
                armed = _asked(client, "kill", _body(self._named))
                command = _asked(client, "kill/confirm", {"code": armed["code"]})
                report = _of_command(command)
                while not report.ended:
                    self._reports.put((BY_SERVICE, report))
                    time.sleep(LOOK_S)
                    report = _of_command(_asked(client, f"commands/{command['id']}"))
        except GcsError as error:
            report = Report(problem=error, ended=True)
        self._reports.put((BY_SERVICE, report))

    def _without_service(self, plan: "KillPlan") -> None:
        from gcs.cli.kill.directly import kill_directly  # noqa: PLC0415 (only where the service is late)

        if not self._arguments.direct:
            why = self._service.problem or "the service is late"
            note(f"{why}; the kill is sent without it", as_json=self._arguments.json)
        names = [*self._direct.outcomes]
        try:
            left_s = self._began_s + WAIT_S - REPORT_S - time.monotonic()
            parts = kill_directly(plan, names, left_s)
        except GcsError as error:
            report = Report(problem=error, ended=True)
        else:
            outcomes = {name: KillOutcome(part.done, part.reason, DIRECTLY) for name, part in parts.items()}
            report = Report(outcomes, accepted=True, ended=True)
        self._reports.put((DIRECTLY, report))

    def _outcomes(self, *, sent: bool) -> dict[str, KillOutcome]:
        """The best of both ways for each vehicle; of two failures both reasons."""
        service, direct = self._service.outcomes, self._direct.outcomes if sent else {}
        outcomes: dict[str, KillOutcome] = {}
        for name in (*service, *(name for name in direct if name not in service)):
            found = [one for one in (service.get(name), direct.get(name)) if one is not None]
            good = next((one for one in found if one.done), None)
            outcomes[name] = good or KillOutcome(
                False, "; ".join(f"{one.way}: {one.reason}" for one in found), "by no way"
            )
        return outcomes

    def _record(self, plan: "KillPlan") -> None:
        """Record what was done without the service, once the motors are off."""
        if plan.record is None or not self._direct.outcomes:
            return
        from gcs.cli.kill.record import record_kill  # noqa: PLC0415 (a second, which no kill waits for)

        done = {name: (one.done, one.reason) for name, one in self._direct.outcomes.items()}
        if problem := record_kill(
            plan.record.parent, done, self._began_unix_s, f"gcs kill ({getpass.getuser()})"
        ):
            note(f"not recorded: {problem}", as_json=self._arguments.json)


NOT_OURS: Final = "the service answers what this program does not understand"
BY_SERVICE: Final = "by the service"
DIRECTLY: Final = "without the service"
DONE, PENDING = "done", "pending"
"""Values of `gcs.service.Outcome`, whose import would load numpy."""


def _of_command(command: Mapping[str, Any]) -> Report:
    """What a command of the service has achieved. Raises: LinkError for an answer of another program."""
    try:
        parts = {name: (part["outcome"], part["reason"]) for name, part in command["outcomes"].items()}
    except (KeyError, TypeError, AttributeError):
        raise LinkError(NOT_OURS) from None
    outcomes = {
        name: KillOutcome(outcome == DONE, reason or ("" if outcome == DONE else outcome), BY_SERVICE)
        for name, (outcome, reason) in parts.items()
    }
    ended = all(outcome != PENDING for outcome, _ in parts.values())
    return Report(outcomes, accepted=True, ended=ended)


def _confirm_code_of_service(arguments: argparse.Namespace) -> int:
    """Confirm a code that `POST /api/v1/kill` gave. Raises: GcsError."""
    wrong = f"{arguments.confirm!r} does not confirm {' '.join(arguments.vehicles) or 'all'}"
    if arguments.direct:
        raise RefusedError(f"{wrong}: leave --confirm out")
    try:
        with closing(exchange(arguments, CONFIRMED_S)) as client:
            command = _asked(client, "kill/confirm", {"code": arguments.confirm})
            report, until_s = _of_command(command), time.monotonic() + WAIT_S
            while not report.ended and time.monotonic() < until_s:
                time.sleep(LOOK_S)
                report = _of_command(_asked(client, f"commands/{command['id']}"))
    except LinkError as error:
        note(f"{error}; without the service then", as_json=arguments.json)
        raise RefusedError(f"{wrong}: leave --confirm out") from None
    return describe(report.outcomes, arguments)


def is_confirmed(arguments: argparse.Namespace, names: Sequence[str], code: str) -> bool:
    """Ask for the second step on a terminal: the operator types the names. Otherwise print how to confirm."""
    note(
        f"this stops the motors of {', '.join(names)}, now, even in the air: they fall",
        as_json=arguments.json,
    )
    if not sys.stdin.isatty():
        again = " ".join(["gcs kill", *(arguments.vehicles or [ALL]), "--confirm", code])
        if arguments.json:
            armed = {"vehicles": [*names], "code": code, "valid_s": CODE_S, "confirm_with": again}
            print_json({"action": "kill", "armed": armed})
        else:
            print(f"nothing has happened yet; within {CODE_S:g} s: {again}")
        return False
    desired = "all" if arguments.all else " ".join(names)
    prompt = sys.stderr if arguments.json else sys.stdout
    print(f"type '{desired}' to kill: ", end="", flush=True, file=prompt)
    if sys.stdin.readline().split() == desired.split():
        return True
    refused = "confirmation does not match; no motors were stopped"
    fail(refused, REFUSED, as_json=arguments.json)
    return False


def describe(outcomes: Mapping[str, KillOutcome], arguments: argparse.Namespace) -> int:
    """Print what was done, to which vehicle, by which way. Returns: the exit code."""
    words = {name: DONE if one.done else "failed" for name, one in outcomes.items()}
    if arguments.json:
        parts = {
            name: {"outcome": words[name], "reason": one.reason, "way": one.way}
            for name, one in outcomes.items()
        }
        print_json({"action": "kill", "vehicles": parts})
    for name, one in () if arguments.json else outcomes.items():
        print(f"{name}: {words[name]} {one.way}{f', {one.reason}' if one.reason else ''}")
    sys.stdout.flush()
    return 0 if all(one.done for one in outcomes.values()) else REFUSED
