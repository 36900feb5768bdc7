"""What traffic is, and the space around it."""

from typing import Final, Literal, TypeAlias

from gcs.model.settings import NotNegative, Positive, Settings

TrackKind: TypeAlias = Literal["manned", "unmanned", "vessel", "ground"]
"""What a track is; an aircraft that does not say counts as manned."""

TRACK_KINDS: Final[tuple[TrackKind, ...]] = ("manned", "unmanned", "vessel", "ground")

VESSEL_S: Final = 200.0
"""A report of a vessel counts so long: AIS of one at anchor reports every 3 minutes. Its deviation grows."""


class Cylinder(Settings):
    """The space around each track that vehicles do not enter."""

    radius_m: Positive = 30.0
    """Radius of the cylinder around each track, in m."""
    half_height_m: Positive = 15.0
    """Half of the cylinder's height, in m."""
    deviations: NotNegative = 3.0
    """It is widened by so many standard deviations of the track's place, to three times its size at most."""
