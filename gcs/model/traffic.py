"""What traffic is, and the space around it."""

from typing import Final, Literal, TypeAlias

from gcs.model.settings import NotNegative, Positive, Settings

TrackKind: TypeAlias = Literal["manned", "unmanned", "vessel", "ground"]
"""What a track is; an aircraft that does not say counts as manned."""

TRACK_KINDS: Final[tuple[TrackKind, ...]] = ("manned", "unmanned", "vessel", "ground")

KIND_IN_WORDS: Final[dict[str, str]] = {
    "manned": "manned aircraft", "unmanned": "drone", "vessel": "vessel", "ground": "ground vehicle",
}  # fmt: skip

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


def distance_in_words(away_m: float, nearest_m: float, nearest_s: float) -> str:
    """How far a track is from the formation, sideways, and how near it will come."""
    away = f"{away_m:.0f} m away" if away_m >= 1.0 else "over, under or within the formation"
    if nearest_s < 1.0:
        return away
    passes = f"at {nearest_m:.0f} m" if nearest_m >= 1.0 else "over, under or through the formation"
    return f"{away}; passes {passes} in {nearest_s:.0f} s"
