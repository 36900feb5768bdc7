"""A flight in virtual time as a drawn show, for viewers and authorities: true positions, and lights."""

from typing import Final

import numpy as np

from gcs.shows.drawn import Claims, DrawnCue, DrawnShow
from gcs.shows.drawn.light_programs import LightProgram
from gcs.shows.formats.samples import through_samples
from gcs.simulation.rehearsal import Rehearsal

SAMPLED_S: Final = 0.25


def drawn(flight: Rehearsal) -> DrawnShow:
    """Return the flight of a show, from hovering above the pads (time 0) to the last touch-down."""
    record, show, timeline = flight.record, flight.loaded.show, flight.timeline
    flown_s = np.array(record.time_s) - record.time_s[0]
    step = max(round(SAMPLED_S / float(np.diff(flown_s).mean())), 1)
    ticks = np.unique(np.append(np.arange(0, len(flown_s), step), len(flown_s) - 1))
    times_s, path_m = np.round(flown_s[ticks], 3), record.path_m[ticks]
    began_s = 0.0 if flight.began_s is None else flight.began_s - record.time_s[0]
    colours = np.stack([timeline.colours_at(max(time_s - began_s, 0.0)) for time_s in times_s.tolist()])
    count = show.fleet.vehicles
    return DrawnShow.of_programs(
        tuple(f"d{row + 1}" for row in range(count)),
        [through_samples(times_s, path_m[:, row]) for row in range(count)],
        [LightProgram(times_s, colours[:-1, row], colours[1:, row]) for row in range(count)],
        title=flight.loaded.name,
        home_m=show.pads_m,
        origin=show.origin.frame,
        cues=tuple(DrawnCue(played.cue.cue, played.at_s + began_s) for played in timeline.played),
        claims=Claims(separation_min_m=round(float(np.min(record.closest_m)), 2)),
    )
