"""`gcs site report`'s page: one file without any other host, that prints, and needs no script."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Final

import numpy as np

from gcs.areas.site import AreaKind, FlightSite, frame_at, polygon_m
from gcs.areas.volumes import Comparison, Volumes
from gcs.cli.sites.fleet_kinds import ReadParameters, fleet_kinds
from gcs.cli.sites.site_map import drawn, legend
from gcs.config.schema import Config
from gcs.links import ParameterValue
from gcs.links.features import FeatureSettings
from gcs.preflight.parameters import broken, requirements_of
from gcs.preflight.requirement import Requirement
from gcs.safety.impact import impacts
from gcs.shows import LoadedShow

NEARLY_M: Final = 0.01
LIMITS_J: Final = "for comparison: 14.9 J and 33.9 J (FAA, operations over people), 80 J (EU class C1)"

ALTERNATIVE: Final = (
    "By authorities, the ground risk buffer is compared with the ballistic fall. The 1:1 rule, mostly wider, "
    "is for information, and not compared. Falls begin at the top of the contingency volume: of the drawn "
    "one, where that is higher than what is needed."
)

BESIDE: Final = "Remote ID, and what else is sent and received"

STYLE: Final = """
body { font: 14px/1.45 system-ui, sans-serif; color: #222; }
body { margin: 2em auto; max-width: 60em; padding: 0 1em; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 1.8em; border-bottom: 2px solid #ccc; }
h3 { font-size: 1em; margin-bottom: .2em; }
table { border-collapse: collapse; width: 100%; margin: .5em 0; }
td, th { border-bottom: 1px solid #ddd; padding: .2em .6em .2em 0; text-align: left; vertical-align: top; }
td.n, th.n { text-align: right; white-space: nowrap; }
tr.sum td { font-weight: 600; border-top: 1px solid #888; }
code { font-size: .85em; word-break: break-all; }
.bad { color: #b3140c; font-weight: 600; } .good { color: #17692b; } p.note { color: #555; }
svg { width: 100%; max-width: 44em; height: auto; border: 1px solid #ddd; }
svg text { font: 11px sans-serif; }
.key { white-space: nowrap; }
.key i { display: inline-block; width: 1em; height: .8em; border: 2px solid; margin: 0 .3em 0 1em; }
@media (max-width: 50em) { table { display: block; overflow-x: auto; } }
@page { margin: 15mm; }
@media print { body { margin: 0; max-width: none; font-size: 11px; }
 h2, h3 { break-after: avoid; } tr, svg { break-inside: avoid; } }
"""


NOT_WEIGHED: Final = (
    "<span class=bad>control.safety.impact.airframe is not set: weigh and measure the vehicles</span>"
)
"""Falls are those of a stand-in then."""


@dataclass(frozen=True, slots=True)
class SiteReported:
    """Everything that the report says."""

    config: Config
    site: FlightSite
    source: str  # the site's file
    volumes: Sequence[Volumes]
    beside: Sequence[Comparison]
    read: ReadParameters
    parameters_hash: str  # empty: none were read
    show: LoadedShow | None
    problems: tuple[str, ...]  # why the show does not fit
    software: str
    made: str

    @property
    def unmet(self) -> dict[str, list[str]]:
        """Parameters that are not as demanded, or were not read; and of which of the vehicles that were."""
        names: dict[str, list[str]] = {}
        for vehicle_id, needed in requirements_of(self.config).items():
            for requirement, _ in broken(needed, self.read[vehicle_id]) if vehicle_id in self.read else ():
                names.setdefault(requirement.name, []).append(vehicle_id)
        return names

    @property
    def is_good(self) -> bool:
        """Whether volumes are wide enough, the show fits, vehicles were weighed, all read is as demanded."""
        if self.problems or self.unmet or self.config.control.safety.impact.airframe is None:
            return False
        spares = [each.spare_m for each in self.beside]
        return all(spare is not None and spare >= -NEARLY_M for spare in spares)


def page(reported: SiteReported) -> str:
    """The page."""
    site = reported.site
    return f"""<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>Site {escape(site.name)}</title><style>{STYLE}</style>
<h1>Site {escape(site.name)}</h1>
<p>{escape(reported.software)}, {escape(reported.made)}. Heights are above the origin of the show frame.</p>
{_hashes(reported)}
{_map(reported)}
{_areas(site)}
{_volumes(reported)}
{_vehicles(reported)}
{_show(reported)}
{_parameters(reported)}
{_features(reported.config)}
</html>
"""


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "", numbers: str = "") -> str:
    """A table of cells in HTML; columns in `numbers` (digits) are aligned right."""
    right = {int(digit) for digit in numbers}

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(f"<{tag}{' class=n' if at in right else ''}>{cell}" for at, cell in enumerate(row))

    title = f"<caption>{caption}</caption>" if caption else ""
    body = "".join(
        f"<tr{' class=sum' if row[0].startswith('<b>') else ''}>{cells('td', row)}" for row in rows
    )
    return f"<table>{title}<tr>{cells('th', head)}{body}</table>"


def _hashes(reported: SiteReported) -> str:
    rows = [
        ("site", escape(reported.source), reported.site.digest),
        *(
            [("show", escape(Path(reported.show.file).name), reported.show.show.digest)]
            if reported.show
            else []
        ),
        ("parameters", "the vehicles", reported.parameters_hash or "not read"),
    ]
    return _table(
        ("Of", "From", "SHA-256"), [(what, file, f"<code>{digest}</code>") for what, file, digest in rows]
    )


def _map(reported: SiteReported) -> str:
    show, paths = reported.show, list[np.ndarray]()
    if show is not None and show.drawing is None:
        times_s = np.arange(0.0, show.timeline.duration_s, 1.0).tolist()
        paths.append(np.array([show.timeline.plan_at(at).target.position_m(at)[:2] for at in times_s]))
    pads_m = None if show is None else show.show.pads_m[:, :2]
    frame = reported.config.frame
    origin = f"{frame.latitude_deg:.7f}, {frame.longitude_deg:.7f}, {frame.altitude_amsl_m:g} m AMSL"
    more = "; dots: pads; dashed: the way of the target" if show else ""
    turned = f"x axis {frame.heading_deg:g} degrees from north"
    return (
        f"<h2>Map</h2>{drawn(reported.site, frame, pads_m, paths)}<p class=note>{legend()}<br>"
        f"cross: origin of the show frame, {origin}, {turned}{more}</p>"
    )


def _areas(site: FlightSite) -> str:
    frame = frame_at(site.flight_geography.corners[0])
    rows = [
        (
            str(area.kind),
            escape(area.name),
            f"{polygon_m(frame, area).area:.0f}",
            f"{area.height_min_m:g}",
            "no limit" if area.height_max_m is None else f"{area.height_max_m:g}",
            "<br>".join(f"{latitude:.7f}, {longitude:.7f}" for latitude, longitude in area.corners),
        )
        for area in site.areas
    ]
    head = ("Kind", "Name", "m²", "From, m", "To, m", "Corners: latitude, longitude (WGS 84)")
    return f"<h2>Areas</h2>{_table(head, rows, numbers='234')}"


def _volumes(reported: SiteReported) -> str:
    parts = ["<h2>Volumes, computed both ways</h2>"]
    rows = []
    for each in reported.beside:
        has = "not drawn" if each.drawn_m is None else f"{each.drawn_m:.1f}"
        good = each.spare_m is not None and each.spare_m >= -NEARLY_M
        spare = "" if each.spare_m is None else f"{each.spare_m:+.1f}"
        verdict = f"<span class={'good' if good else 'bad'}>{'wide enough' if good else 'missing'}</span>"
        rows.append((each.what, each.method, each.autopilot, f"{each.needed_m:.1f}", has, spare, verdict))
    head = ("What", "By", "Autopilot", "Needed, m", "Drawn, m", "Spare, m", "")
    parts.append(_table(head, rows, numbers="345"))
    for volumes in reported.volumes:
        parts.append(f"<h3>By {volumes.method}, {volumes.autopilot}</h3>")
        terms = []
        for extent in volumes.extents:
            terms += [
                (term.name, f"{term.value_m:.2f}", escape(term.formula), escape(term.source))
                for term in extent.terms
            ]
            terms.append((f"<b>{extent.what}</b>", f"{extent.value_m:.2f}", "", ""))
        parts.append(_table(("Term", "m", "Formula", "Source"), terms, numbers="1"))
    parts.append(f"<p class=note>{ALTERNATIVE}</p>")
    return "".join(parts)


def _vehicles(reported: SiteReported) -> str:
    safety = reported.config.control.safety
    frame, limits, fence = safety.impact.falling, safety.limits, safety.fence
    drawn_above = reported.site.of(AreaKind.CONTINGENCY)
    falls = impacts(
        np.array([[0.0, 0.0, -max([fence.height_max_m, *(area.top_m for area in drawn_above)])]]),
        np.array([[limits.horizontal_m_s, 0.0, 0.0]]),
        safety.impact,
    )
    rows = [
        *(() if safety.impact.airframe else [(NOT_WEIGHED, "PX4's simulator, a stand-in:")]),
        ("greatest extent", f"{frame.dimension_m:g} m"),
        ("mass in flight", f"{frame.mass_kg:g} kg"),
        ("drag coefficient x area", f"{frame.drag_area_m2:g} m²"),
        ("speed of a long fall", f"{frame.terminal_m_s:.1f} m/s"),
        (
            "greatest speeds",
            f"{limits.horizontal_m_s:g} m/s level, {limits.up_m_s:g} up, {limits.down_m_s:g} down",
        ),
        ("greatest wind", f"{safety.impact.wind_max_m_s:g} m/s, from every side"),
        ("heights", f"{fence.height_min_m:g} to {fence.height_max_m:g} m"),
        (
            "greatest energy of an impact",
            f"{falls.energy_j[0]:.0f} J at {falls.speed_m_s[0]:.1f} m/s; {LIMITS_J}",
        ),
        (
            "least distance of two vehicles",
            f"{safety.floor.horizontal_m:g} m sideways, {safety.floor.vertical_m:g} m up",
        ),
    ]
    kinds = [
        (
            kind.autopilot,
            f"{kind.vehicles}",
            f"{kind.loss.flies_on_s:g}",
            kind.loss.action,
            f"{kind.tilt_deg:g}",
            f"{kind.fence_period_s:g}",
        )
        for kind in fleet_kinds(reported.config, reported.read)
    ]
    head = ("Autopilot", "Vehicles", "Flies on, s", "Then", "Tilt, degrees", "Fence noticed in, s")
    return f"<h2>Vehicles</h2>{_table(('', ''), rows)}{_table(head, kinds, numbers='1245')}"


def _show(reported: SiteReported) -> str:
    show = reported.show
    if show is None:
        return ""
    problems = "".join(f"<li class=bad>{escape(each)}" for each in reported.problems)
    fits = (
        f"<ul>{problems}</ul>"
        if problems
        else "<p class=good>It fits the areas, the limits and the frame.</p>"
    )
    rows = [
        (escape(played.cue.cue), f"{played.at_s:g}") for played in show.timeline.played if played.passage == 1
    ]
    about = f"{show.show.fleet.vehicles} vehicles, {show.timeline.duration_s:g} s: {escape(show.show.about)}"
    flown = "<p class=note>gcs show check SHOW --config CONFIG flies it in virtual time as well.</p>"
    cues = _table(("Cue", "At, s"), rows, numbers="1")
    return f"<h2>Show {escape(show.name)}</h2><p>{about}</p>{fits}{cues}{flown}"


def _parameters(reported: SiteReported) -> str:
    """What is demanded of each parameter, and what the vehicles have."""
    config = reported.config
    demanded: dict[tuple[str, str, str], list[str]] = {}
    of_key: dict[tuple[str, str, str], Requirement] = {}
    for name, needed in requirements_of(config).items():
        for each in needed:
            key = config.autopilots[name], each.name, each.desired
            demanded.setdefault(key, []).append(name)
            of_key[key] = each
    counts = Counter(config.autopilots.values())
    rows = [
        (
            autopilot,
            parameter if len(names) == counts[autopilot] else f"{parameter}<br>{escape(', '.join(names))}",
            desired,
            _values(reported.read, of_key[autopilot, parameter, desired], names),
            escape(of_key[autopilot, parameter, desired].why),
        )
        for (autopilot, parameter, desired), names in demanded.items()
    ]
    head = ("Autopilot", "Parameter", "Demanded", "Read", "Why")
    note = (
        ""
        if reported.read
        else "<p class=note>Not read: gcs params check --config CONFIG --json writes them.</p>"
    )
    unmet = "".join(f"<li class=bad>{name}: {escape(', '.join(of))}" for name, of in reported.unmet.items())
    listed = f"<p class=bad>Not as demanded, or not read:</p><ul>{unmet}</ul>" if unmet else ""
    return f"<h2>Parameters</h2>{note}{listed}{_table(head, rows)}"


def _values(read: ReadParameters, needed: Requirement, names: Sequence[str]) -> str:
    """The values of these vehicles: one, or each with its vehicles; what is not as demanded is marked."""
    if not read:
        return "-"
    by_value: dict[str, list[str]] = {}
    for name in names:
        by_value.setdefault(_value(read.get(name, {}), needed), []).append(name)
    if len(by_value) == 1:
        return next(iter(by_value))
    return "; ".join(f"{value}: {', '.join(map(escape, of))}" for value, of in by_value.items())


def _value(values: Mapping[str, ParameterValue], needed: Requirement) -> str:
    """Of one vehicle's values: that of the parameter, or of the one that other versions have in its place."""
    value, other = values.get(needed.name), needed.otherwise
    if value is None and other is not None and other.name in values:
        return f"{escape(other.name)} in its place: {_value(values, other)}"
    if value is None:
        return "its version has none" if values and needed.lacking is not None else "not read"
    either = (needed, other or needed)
    if needed.unless or any(each.holds(value) for each in either):
        return f"{value:g}"
    return f"<span class=bad>{value:g}: not as demanded</span>"


def _features(config: Config) -> str:
    """What is sent and received beside the flight, Remote ID for example, as the configuration has it."""
    sections = config.model_dump(mode="json", include=set(FeatureSettings.model_fields))
    usual = FeatureSettings().model_dump(mode="json")
    rows = [
        (f"{escape(name)}.{escape(key)}", escape(str(value)))
        for name, section in sections.items()
        if isinstance(section, dict) and section != usual.get(name)
        for key, value in section.items()
        if value not in (None, "", {}, [])
    ]
    if not rows:
        return f"<h2>{BESIDE}</h2><p class=note>The configuration has none of it, and no Remote ID.</p>"
    return f"<h2>{BESIDE}</h2>{_table(('Key', 'Value'), rows)}"
