"""What holds for every drawing: light code and Bezier curves survive an export and an import."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.shows.drawn import DrawnShow, LightPrograms, Trajectories, Trajectory, YawPrograms
from gcs.shows.drawn.light_programs import WHITE, LightProgram
from gcs.shows.drawn.trajectories import power_of_bezier
from gcs.shows.drawn.yaw_programs import NO_YAW
from gcs.shows.formats import parse_drawing
from gcs.shows.formats.skybrush_lights import TICK_S, decoded, encoded
from gcs.shows.formats.skybrush_writer import write_skyc

COLOUR = st.tuples(*[st.integers(0, 255)] * 3)
PIECE = st.tuples(st.integers(1, 400), COLOUR, st.one_of(st.none(), COLOUR))
"""Ticks, colour at the beginning, colour at the end; None: the same."""


@given(pieces=st.lists(PIECE, min_size=1, max_size=30))
def test_light_code_keeps_every_colour(
    pieces: list[tuple[int, tuple[int, ...], tuple[int, ...] | None]],
) -> None:
    times_s = TICK_S * np.cumsum([0, *(ticks for ticks, _, _ in pieces)])
    before = np.array([first for _, first, _ in pieces], np.uint8)
    after = np.array([last or first for _, first, last in pieces], np.uint8)
    program = LightPrograms.joined([LightProgram(times_s, before, after)])
    again = LightPrograms.joined([decoded(encoded(program.of_vehicle(0)), "here", 1e4).program])
    within_s = np.unique(
        np.concatenate([times_s[:-1] + 1e-4, (times_s[:-1] + times_s[1:]) / 2, times_s[1:] - 1e-4])
    )
    for time_s in within_s.tolist():
        assert np.abs(program.at(time_s) - again.at(time_s)).max() <= 1e-6


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), degree=st.integers(1, 7), pieces=st.integers(1, 6))
def test_curves_of_every_degree_survive_skyc_within_a_centimetre(seed: int, degree: int, pieces: int) -> None:
    rng = np.random.default_rng(seed)
    points_m = rng.uniform(-80.0, 80.0, (pieces, degree + 1, 3))
    points_m[1:, 0] = points_m[:-1, -1]
    times_s = rng.uniform(0.0, 20.0) + np.append(0.0, np.cumsum(rng.uniform(2.0, 30.0, pieces)))
    trajectories = Trajectories.joined([Trajectory(times_s, power_of_bezier(points_m))])
    show = DrawnShow(
        title="",
        vehicles=("one",),
        trajectories=trajectories,
        lights=LightPrograms.joined([WHITE]),
        yaw=YawPrograms.joined([NO_YAW]),
        home_m=points_m[0, :1],
        takeoff_s=times_s[:1],
        landing_s=times_s[-1:],
    )
    again = parse_drawing(write_skyc(show), "a.skyc").trajectories
    for time_s in np.linspace(times_s[0], times_s[-1], 200).tolist():
        apart_m = trajectories.at(time_s).position_m - again.at(time_s).position_m
        assert np.linalg.norm(apart_m) <= 0.01
