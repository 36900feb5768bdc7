"""`gcs params`: compares the vehicles' parameters with the required values, and sets them."""

import argparse
import asyncio
import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from gcs.cli.output import REFUSED, answer, fail
from gcs.cli.service.process import set_up_log
from gcs.cli.service.serve import load_here, make_link
from gcs.config.schema import Config
from gcs.links import ParameterValue
from gcs.links.autopilots.versions import Version
from gcs.links.batch_link import Link
from gcs.links.link_set import leaves
from gcs.model.errors import CommandError, ConfigError, LinkError
from gcs.model.state import Mode, Setpoints, VehicleId
from gcs.preflight.parameters import FleetRequirements
from gcs.preflight.requirement import Requirement
from gcs.preflight.versions import missing_to_do, version_checks, version_risks

REACHED_S = 3.0
"""Time for the link to become able to read parameters, once the vehicle was received."""

VERSION_S = 4.0
"""Longest wait for the vehicles' versions, which say which parameters there are."""

POLL_S = 0.1

LACKING = "not of this version"
"""Verdict on a parameter that the vehicle need not have."""

OPEN = "to be set by its owner"
"""Verdict on a parameter that this station does not set, and that refuses no start."""

MISSING = "there is no such parameter, or the vehicle does not answer"

APPLY = "gcs params apply --config {}"


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One parameter of one vehicle."""

    vehicle: VehicleId
    parameter: str
    value: ParameterValue | None  # None: not readable
    desired: str
    verdict: str  # "ok", "set", LACKING or OPEN and what it means, or what is wrong
    to_do: str = ""  # how to correct it

    @property
    def good(self) -> bool:
        return self.verdict in {"ok", "set"} or self.verdict.startswith((LACKING, OPEN))


def run_params(arguments: argparse.Namespace) -> int:
    """Check or apply. Returns: 0 when all parameters have their required values, 1 otherwise."""
    set_up_log(logging.ERROR)
    config, _ = load_here(arguments.config, arguments.station)
    chosen = _chosen(config, arguments.vehicles)
    if not 0.0 < arguments.wait <= 3600.0:
        raise ConfigError(f"--wait {arguments.wait:g}: above 0, at most 3600 s")
    failures: list[str] = []
    rows: list[ParameterRow] = []
    try:
        named, apply = arguments.vehicles is not None, arguments.action == "apply"
        rows = asyncio.run(_with_links(config, chosen, arguments.wait, named=named, apply=apply))
    except* LinkError as group:
        failures = [str(error) for error in leaves(group)]
    if failures:
        fail(f"{'; '.join(failures)}; stop gcs serve first", REFUSED, as_json=arguments.json)
        return REFUSED
    good = bool(rows) and all(row.good for row in rows)
    answer(arguments, {"good": good, "rows": [asdict(row) for row in rows]}, table(rows))
    if not arguments.json and (text := advice(rows, arguments.config)):
        print(f"\n{text}")
    return 0 if good else 1


def _chosen(config: Config, text: str | None) -> tuple[VehicleId, ...]:
    if text is None:
        return config.ids
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    unknown = [name for name in names if name not in config.ids]
    if unknown:
        raise ConfigError(f"--vehicles {text}: no {', '.join(unknown)}; there are {', '.join(config.ids)}")
    return names


async def _with_links(
    config: Config, chosen: Sequence[VehicleId], wait_s: float, *, named: bool, apply: bool
) -> list[ParameterRow]:
    """Open the links, and inspect all vehicles at once. Raises: LinkErrors in a group, for ports in use."""
    links = [make_link(settings, config) for settings in config.links]
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(link.run(), name=f"link/{link.name}") for link in links]
        tasks.append(group.create_task(_keep_alive(links), name="alive"))
        rows = await inspect(links, config, chosen, wait_s, named=named, apply=apply)
        for task in tasks:
            task.cancel()
    return rows


async def _keep_alive(links: Sequence[Link]) -> None:
    """Send empty setpoints repeatedly: without them the links stop heartbeats, and `udpout` sends nothing."""
    nothing = np.zeros((0, 3)), np.zeros(0)
    while True:
        for link in links:
            link.send(Setpoints(asyncio.get_running_loop().time(), (), *nothing))
        await asyncio.sleep(POLL_S)


async def inspect(
    links: Sequence[Link],
    config: Config,
    chosen: Sequence[VehicleId],
    wait_s: float,
    *,
    named: bool,
    apply: bool,
) -> list[ParameterRow]:
    """Return the rows of all `chosen` vehicles; without telemetry only if the operator `named` them."""
    link_of = {name: link for link in links for name in link.ids}
    received = await _received(link_of, chosen, wait_s)
    requirements = FleetRequirements(config)
    versions = await _versions(link_of, received)

    async def rows_of(name: VehicleId) -> list[ParameterRow]:
        if foreign := link_of[name].foreign.get(name):
            to_do = "correct autopilot in the configuration, of the vehicle or its link"
            return [ParameterRow(name, "autopilot", None, "as configured", foreign, to_do)]
        known, version = requirements.profiles[name].versions, versions[name]
        rows = [
            ParameterRow(name, check.name, None, check.limit, check.problem, check.to_do)
            for check in version_checks(known, version)
            if not check.passes
        ]
        if rows:
            return rows
        rows = [
            ParameterRow(name, "version", None, known.supported, f"{OPEN}: {text}")
            for text in version_risks(known, version)
        ]
        one = _Vehicle(link_of[name], name, missing_to_do(known, version), apply)
        needed = requirements.of(name, version)
        made = {each: await one.row(each) for each in needed if not each.may_lack}
        unsure = [each for each in needed if each.may_lack]  # seconds each, where there is none
        made |= dict(zip(unsure, await asyncio.gather(*map(one.row, unsure)), strict=True))
        return [*rows, *(made[each] for each in needed)]

    parts = await asyncio.gather(*(rows_of(name) for name in chosen if name in received))
    silent = [name for name in chosen if name not in received] if named or not received else []
    text, to_do = f"not received within {wait_s:g} s", "look after its power and its link, and try again"
    return [row for part in parts for row in part] + [
        ParameterRow(name, "-", None, "-", text, to_do) for name in silent
    ]


async def _versions(
    link_of: Mapping[VehicleId, Link], names: Collection[VehicleId]
) -> dict[VehicleId, Version | None]:
    """Return the version of each of `names` as soon as all are known, or after `VERSION_S`."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + VERSION_S
    while True:
        links = {id(link_of[name]): link_of[name] for name in names}.values()
        found = {
            name: Version.of(raw)
            for link in links
            for name, raw in zip(link.ids, link.snapshot().version, strict=True)
            if name in names
        }
        if all(found.values()) or loop.time() >= until_s:
            return found
        await asyncio.sleep(POLL_S)


async def _received(
    link_of: Mapping[VehicleId, Link], chosen: Sequence[VehicleId], wait_s: float
) -> set[VehicleId]:
    """Return the `chosen` vehicles that were received, as soon as all were, or after `wait_s`."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + wait_s
    while True:
        received = {
            name
            for link in {id(link_of[name]): link_of[name] for name in chosen}.values()
            for name, mode in zip(link.ids, link.snapshot().mode, strict=True)
            if name in chosen and mode is not Mode.UNKNOWN
        }
        if len(received) == len(chosen) or loop.time() >= until_s:
            return received
        await asyncio.sleep(POLL_S)


@dataclass(frozen=True, slots=True)
class _Vehicle:
    """One vehicle whose parameters are compared, and set."""

    link: Link
    name: VehicleId
    missing_to_do: str
    apply: bool

    async def row(self, requirement: Requirement) -> ParameterRow:
        """Return the row of a requirement, in the name that the vehicle has."""
        try:
            value = None if requirement.is_absent else await self._read(requirement.name)
            if value is not None:
                return await self._compared(requirement, value)
        except CommandError as error:
            text = str(error).removeprefix(f"{self.name}: ")
            return self._row(requirement, None, text, "look after its link, and try again")
        if requirement.otherwise is not None:
            return await self.row(requirement.otherwise)
        if requirement.lacking is not None:
            lacking = f"{LACKING}: {requirement.lacking}" if requirement.lacking else LACKING
            return self._row(requirement, None, lacking)
        return self._row(requirement, None, MISSING, self.missing_to_do)

    async def _compared(self, requirement: Requirement, value: ParameterValue) -> ParameterRow:
        """Return the row of a value, which is set before if it may be. Raises: CommandError."""
        values = {requirement.name: value}
        if requirement.unless:
            values[requirement.unless] = await self._read(requirement.unless) or 0
        if requirement.is_met(values):
            return self._row(requirement, value, "ok")
        if requirement.risk:
            return self._row(requirement, value, f"{OPEN}: {requirement.risk}")
        if not self.apply:
            return self._row(requirement, value, f"wrong: {requirement.why}", APPLY)
        if self.link.snapshot().armed[self.link.ids.index(self.name)]:
            to_do = f"once it is disarmed: {APPLY}"
            return self._row(requirement, value, "wrong, and not set: the vehicle is armed", to_do)
        await self.link.set_parameter(self.name, requirement.name, requirement.set_to)
        kept = await self._read(requirement.name)
        if kept is not None and requirement.holds(kept):
            return self._row(requirement, kept, "set")
        text = f"set to {requirement.set_to:g}, but the vehicle keeps it"
        to_do = "restart the vehicle, and look whether another program or its firmware fixes the value"
        return self._row(requirement, kept, text, to_do)

    def _row(
        self, requirement: Requirement, value: ParameterValue | None, verdict: str, to_do: str = ""
    ) -> ParameterRow:
        return ParameterRow(self.name, requirement.name, value, requirement.desired, verdict, to_do)

    async def _read(self, name: str) -> ParameterValue | None:
        """Read one; retry for `REACHED_S` while the link receives the vehicle but cannot read it yet.

        Returns: None when the vehicle does not answer for it. Raises: CommandError.
        """
        loop = asyncio.get_running_loop()
        until_s = loop.time() + REACHED_S
        while True:
            try:
                return (await self.link.read_parameters(self.name, (name,), (name,))).get(name)
            except CommandError as error:
                if "never received" not in str(error) or loop.time() >= until_s:
                    raise
            await asyncio.sleep(POLL_S)


def advice(rows: Sequence[ParameterRow], config: object) -> str:
    """What corrects the rows that are not good, in words; empty: all are."""
    to_do = dict.fromkeys(row.to_do.replace(APPLY, APPLY.format(config)) for row in rows if not row.good)
    return f"to mend this: {'; '.join(to_do)}" if to_do else ""


def table(rows: Sequence[ParameterRow]) -> str:
    if not rows:
        return "no vehicle was received"
    cells = [("vehicle", "parameter", "value", "desired", "verdict")]
    for row in rows:
        value = "?" if row.value is None else f"{row.value:g}"
        cells.append((row.vehicle, row.parameter, value, row.desired, row.verdict))
    widths = [max(len(line[column]) for line in cells) for column in range(4)]
    return "\n".join(
        "  ".join([*(cell.ljust(width) for cell, width in zip(line, widths, strict=False)), line[-1]])
        for line in cells
    )
