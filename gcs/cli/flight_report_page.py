"""`gcs report --html`: the report on a flight as one self-contained HTML page with its plots."""

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape
from io import StringIO
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from gcs.cli.output import kinds
from gcs.recording.flight_report import SMOOTHED_S, TOLERATED, TOLERATED_M_S, TOLERATED_M_S2, FlightReport
from gcs.service.go import StartMade
from gcs.service.snapshots import GroundKept, TargetTracking, TrackPassed

SHOWN_PATHS: Final = 80
POINTS_MAX: Final = 1500
"""Most points of a line: more are not visible, and enlarge the page."""

WORDS: Final = {
    "kept": "Kept: all was judged, nothing was broken",
    "broken": "Broken",
    "incomplete": "Incomplete: not all could be judged",
}

STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; }
body { margin: 2em auto; max-width: 62em; padding: 0 1em; }
h1 { font-size: 1.4em; } .kept { color: #17692b; } .broken { color: #b3140c; font-weight: 600; }
.incomplete { color: #8a5a00; font-weight: 600; } .unjudged { color: #666; }
table { border-collapse: collapse; margin: 1em 0; width: 100%; } th { text-align: left; }
td, th { border-bottom: 1px solid #ddd; padding: .25em .7em .25em 0; } td.n { text-align: right; }
svg { width: 100%; height: auto; } .pairs { columns: 2; } p.note { background: #fff4d6; padding: .5em; }
"""


def page(flight_report: FlightReport, source: str) -> str:
    trajectories = flight_report.trajectories
    with mpl.rc_context({"svg.hashsalt": "gcs", "svg.fonttype": "none", "font.size": 9}):
        text = StringIO()
        figure(flight_report).savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    kind, word = flight_report.verdict, WORDS[flight_report.verdict]
    counts = kinds(Counter(trajectories.autopilots))
    known = escape(f" ({counts})" if counts else "")
    hashes = "".join(f"<br>{what} <code>{digest}</code>" for what, digest in flight_report.hashes)
    wind = f"<br>Wind {escape(flight_report.wind)}." if flight_report.wind else ""
    reported = (*trajectories.remarks, *(f"Not judged: {text}" for text in flight_report.missing))
    notes = "".join(f"<p class=note>{escape(remark)}</p>" for remark in reported)
    return f"""<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>Flight: {escape(word)}</title><style>{STYLE}</style>
<h1>Flight of {len(trajectories.ids)} vehicles{known}, {flight_report.duration_s:.0f} s:
<span class={kind}>{escape(word)}</span></h1>
<p>Based on <b>{escape(trajectories.based_on)}</b>: {escape(trajectories.uncertainty)}.<br>
From {escape(source)}; judged {datetime.now(UTC):%Y-%m-%d %H:%M} UTC. Speeds and accelerations are means over
{SMOOTHED_S:g} s of vehicles that the service flew; a vehicle may pass what was commanded by
{TOLERATED:.0%} and {TOLERATED_M_S:g} m/s ({TOLERATED_M_S2:g} m/s²).{hashes}{wind}</p>
{notes}
{_checks(flight_report)}
{_starts(flight_report.trajectories.starts)}
{_listed("Targets that were followed", flight_report.trajectories.tracking)}
{_listed("Traffic that came near", flight_report.trajectories.traffic)}
{_listed("Controlled ground", () if flight_report.ground is None else (flight_report.ground,))}
{svg[svg.index("<svg") :]}
{_pairs(flight_report)}
</html>
"""


def _checks(flight_report: FlightReport) -> str:
    rows = []
    for check in flight_report.checks:
        worst = "-" if check.worst is None else f"{check.worst:.4g}"
        when = "" if check.at_s is None else f"{check.at_s:.1f} s"
        kind = {True: "kept", False: "broken", None: "unjudged"}[check.kept]
        word = "nothing to judge" if check.kept is None else kind
        rows.append(
            f"<tr><td>{escape(check.name)}<td class=n>{worst}<td class=n>{check.limit:g}"
            f"<td>{escape(check.unit + check.leeway)}<td>{escape(check.vehicle)}<td class=n>{when}"
            f"<td class={kind}>{word}"
        )
    head = "<tr><th>What<th>Worst<th>Limit<th>Unit<th>Vehicle<th>At<th>Verdict"
    return f"<table>{head}{''.join(rows)}</table>"


def _starts(starts: Sequence[StartMade]) -> str:
    texts = [f"<li>{escape(line)}" for start in starts for line in start.lines]
    return f"<h2>Who started, and what was signed and entered</h2><ul>{''.join(texts)}</ul>" if texts else ""


def _listed(
    title: str, each_of: tuple[TargetTracking, ...] | tuple[TrackPassed, ...] | tuple[GroundKept, ...]
) -> str:
    texts = [f"<li>{escape(each.text)}" for each in each_of]
    return f"<h2>{title}</h2><ul>{''.join(texts)}</ul>" if texts else ""


def _pairs(flight_report: FlightReport) -> str:
    trajectories, pairs = flight_report.trajectories, flight_report.pairs
    rows = [
        f"<tr><td>{escape(trajectories.ids[i])}"
        f"<td>{escape(trajectories.ids[j])}<td class=n>{pairs.distance_m[i, j]:.2f}"
        f"<td class=n>{pairs.ratio[i, j]:.2f}<td class=n>{pairs.sure_ratio[i, j]:.2f}"
        f"<td class=n>{trajectories.time_s[pairs.sample[i, j]] - trajectories.time_s[0]:.1f}"
        for i, j in pairs.nearest(20)
    ]
    head = (
        "<tr><th>Pair<th><th>Least distance, m<th>As a share of the floor"
        "<th>If both were off by their margin<th>At, s"
    )
    return f"<h2>Nearest pairs</h2><table>{head}{''.join(rows)}</table>"


def figure(flight_report: FlightReport) -> Figure:
    drawn = Figure(figsize=(11.0, 7.4), layout="constrained")
    above, separation, height, speed = drawn.subplots(2, 2).ravel()
    _from_above(above, flight_report)
    _separation(separation, flight_report)
    _heights(height, flight_report)
    _speeds(speed, flight_report)
    for axes in (separation, height, speed):
        axes.set_xlim(0.0, flight_report.duration_s)
    return drawn


def _shown(flight_report: FlightReport) -> tuple[np.ndarray, np.ndarray]:
    k, n = flight_report.trajectories.airborne.shape
    samples = np.unique(np.linspace(0, k - 1, min(k, POINTS_MAX)).astype(int))
    return samples, np.unique(np.linspace(0, n - 1, min(n, SHOWN_PATHS)).astype(int))


def _from_above(axes: Axes, flight_report: FlightReport) -> None:
    trajectories, fence = flight_report.trajectories, flight_report.standard.safety.fence
    samples, rows = _shown(flight_report)
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.92, len(rows)))
    for row, colour in zip(rows, colours, strict=True):
        flies = trajectories.airborne[samples, row, None]
        place_m = np.where(flies, trajectories.position_m[samples, row], np.nan)
        axes.plot(place_m[:, 1], place_m[:, 0], color=colour, linewidth=0.7)
    axes.set_aspect("equal", adjustable="datalim")
    axes.apply_aspect()
    box = axes.get_xlim(), axes.get_ylim()
    axes.add_patch(Circle((0, 0), fence.distance_max_m, fill=False, color="#b3140c", linestyle="--"))
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(box[0])
    axes.set_ylim(box[1])
    axes.set(title="Paths from above (dashed: fence)", xlabel="y, m", ylabel="x, m")


def _time_s(flight_report: FlightReport) -> np.ndarray:
    return np.asarray(flight_report.trajectories.time_s - flight_report.trajectories.time_s[0])


def _separation(axes: Axes, flight_report: FlightReport) -> None:
    floor, least_m = flight_report.standard.safety.floor, flight_report.least_m
    k = len(least_m)
    starts = np.unique(np.linspace(0, k - 1, min(k, POINTS_MAX)).astype(int))
    lowest_m = np.minimum.reduceat(least_m, starts)  # over all samples, including those not drawn
    known_m = np.where(np.isfinite(lowest_m), lowest_m, np.nan)
    axes.plot(_time_s(flight_report)[starts], known_m, linewidth=0.9)
    axes.axhspan(0.0, floor.horizontal_m, color="#b3140c", alpha=0.15)
    axes.axhline(floor.vertical_m, color="#b3140c", linestyle=":", linewidth=0.9)
    axes.set_ylim(bottom=0.0)
    axes.set(title="Least distance of all pairs (red: floor; dotted: above)", xlabel="s", ylabel="m")


def _heights(axes: Axes, flight_report: FlightReport) -> None:
    trajectories, fence = flight_report.trajectories, flight_report.standard.safety.fence
    samples, rows = _shown(flight_report)
    axes.plot(_time_s(flight_report)[samples], -trajectories.position_m[samples][:, rows, 2], linewidth=0.5)
    axes.axhline(fence.height_min_m, color="#b3140c", linestyle=":", linewidth=0.9)
    highest_m = float(np.nanmax(-trajectories.position_m[..., 2], initial=0.0))
    if highest_m > 0.6 * fence.height_max_m:
        axes.axhline(fence.height_max_m, color="#b3140c", linestyle="--", linewidth=0.9)
    title = f"Heights (fence: {fence.height_min_m:g} to {fence.height_max_m:g} m)"
    axes.set(title=title, xlabel="s", ylabel="m")


def _speeds(axes: Axes, flight_report: FlightReport) -> None:
    trajectories, limits = flight_report.trajectories, flight_report.standard.safety.limits
    samples, _ = _shown(flight_report)
    velocity_m_s = np.where(trajectories.flown[samples, :, None], trajectories.velocity_m_s[samples], np.nan)
    time_s = _time_s(flight_report)[samples]
    flat_m_s, up_m_s = np.hypot(velocity_m_s[..., 0], velocity_m_s[..., 1]), -velocity_m_s[..., 2]
    for value, name in ((flat_m_s, "sideways"), (up_m_s, "up"), (-up_m_s, "down")):
        most = np.max(np.nan_to_num(value, nan=-np.inf), axis=1)
        axes.plot(time_s, np.where(np.isfinite(most), most, np.nan), linewidth=0.9, label=name)
    for limit, colour in ((limits.horizontal_m_s, "C0"), (limits.up_m_s, "C1"), (limits.down_m_s, "C2")):
        axes.axhline(limit, color=colour, linestyle="--", linewidth=0.8)
    axes.legend(loc="upper right")
    axes.set_ylim(bottom=0.0)
    axes.set(title="Greatest speeds of those flown (dashed: limits)", xlabel="s", ylabel="m/s")
