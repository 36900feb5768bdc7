"""`gcs params`: compares the vehicles' parameters with the required values, and sets them."""

import argparse
import asyncio
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from gcs.cli.output import REFUSED, answer, fail
from gcs.cli.process import set_up_log
from gcs.cli.serve import load_here, make_link
from gcs.config.schema import Config
from gcs.links import ParameterValue
from gcs.links.batch_link import Link
from gcs.links.link_set import leaves
from gcs.model.errors import CommandError, ConfigError, LinkError
from gcs.model.state import Mode, Setpoints, VehicleId
from gcs.preflight.parameters import requirements_of
from gcs.preflight.requirement import Requirement

REACHED_S = 3.0
"""Time for the link to become able to read parameters, once the vehicle was received."""

POLL_S = 0.1

LACKING = "not of this version"
"""Verdict on a parameter that the vehicle need not have."""


@dataclass(frozen=True, slots=True)
class Row:
    """One parameter of one vehicle."""

    vehicle: VehicleId
    parameter: str
    value: ParameterValue | None  # None: not readable
    desired: str
    verdict: str  # "ok", "set", LACKING and what it means, or what is wrong

    @property
    def good(self) -> bool:
        return self.verdict in {"ok", "set"} or self.verdict.startswith(LACKING)


def run_params(arguments: argparse.Namespace) -> int:
    """Check or apply. Returns: 0 when all parameters have their required values, 1 otherwise."""
    set_up_log(logging.ERROR)
    config, _ = load_here(arguments.config, arguments.station)
    chosen = _chosen(config, arguments.vehicles)
    if not 0.0 < arguments.wait <= 3600.0:
        raise ConfigError(f"--wait {arguments.wait:g}: above 0, at most 3600 s")
    failures: list[str] = []
    rows: list[Row] = []
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
    if not arguments.json and rows and not good and arguments.action == "check":
        print(f"\nto mend this: gcs params apply --config {arguments.config}")
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
) -> list[Row]:
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
) -> list[Row]:
    """Return the rows of all `chosen` vehicles; without telemetry only if the operator `named` them."""
    link_of = {name: link for link in links for name in link.ids}
    received = await _received(link_of, chosen, wait_s)
    needed = requirements_of(config)

    async def rows_of(name: VehicleId) -> list[Row]:
        return [await _row(link_of[name], name, requirement, apply=apply) for requirement in needed[name]]

    parts = await asyncio.gather(*(rows_of(name) for name in chosen if name in received))
    silent = [name for name in chosen if name not in received] if named or not received else []
    not_received = [Row(name, "-", None, "-", f"not received within {wait_s:g} s") for name in silent]
    return [row for part in parts for row in part] + not_received


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


async def _row(link: Link, name: VehicleId, requirement: Requirement, *, apply: bool) -> Row:
    value: ParameterValue | None = None

    def row(verdict: str) -> Row:
        return Row(name, requirement.name, value, requirement.desired, verdict)

    try:
        value = await _read(link, name, requirement)
        if value is None and requirement.otherwise is not None:
            return await _row(link, name, requirement.otherwise, apply=apply)
        if value is None:
            return row(f"{LACKING}: {requirement.lacking}" if requirement.lacking else LACKING)
        if requirement.holds(value):
            return row("ok")
        if not apply:
            return row(f"wrong: {requirement.why}")
        if link.snapshot().armed[link.ids.index(name)]:
            return row("wrong, and not set: the vehicle is armed")
        await link.set_parameter(name, requirement.name, requirement.set_to)
        value = await _read(link, name, requirement)
    except CommandError as error:
        return row(str(error).removeprefix(f"{name}: "))
    kept = f"set to {requirement.set_to:g}, but the vehicle keeps it"
    return row("set" if value is not None and requirement.holds(value) else kept)


async def _read(link: Link, vehicle_id: VehicleId, requirement: Requirement) -> ParameterValue | None:
    """Read one; retry for `REACHED_S` while the link receives the vehicle but cannot read it yet.

    Returns: None when the vehicle does not have it, and need not.
    """
    name = requirement.name
    loop = asyncio.get_running_loop()
    until_s = loop.time() + REACHED_S
    while True:
        try:
            return (await link.read_parameters(vehicle_id, (name,), (name,) * requirement.may_lack)).get(name)
        except CommandError as error:
            if "never received" not in str(error) or loop.time() >= until_s:
                raise
        await asyncio.sleep(POLL_S)


def table(rows: Sequence[Row]) -> str:
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
