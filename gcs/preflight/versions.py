"""What is said of a vehicle's version before a start. Pure."""

from collections.abc import Iterator

from gcs.links.autopilots.versions import Version, Versions
from gcs.model.preflight_report import Check, State

CHECK = "version"


def version_checks(versions: Versions, version: Version | None) -> list[Check]:
    """Return the check of its version; none before it is received: then the names of parameters tell."""
    if version is None:
        return []
    if not versions.is_too_old(version):
        return [Check(CHECK, State.PASS, limit=versions.supported)]
    problem = f"it has {versions.title} {version}, {versions.supported} can be flown"
    return [Check(CHECK, State.FAIL, None, "", versions.supported, problem, "update its firmware")]


def version_risks(versions: Versions, version: Version | None) -> Iterator[str]:
    """Yield what remains unknown, in words."""
    if version is None:
        yield (
            "its version is not known (no AUTOPILOT_VERSION): the names of its parameters tell which it has"
            f" of {versions.supported}"
        )
    if versions.is_newer(version):
        yield (
            f"it has {versions.title} {version}, newer than what this station knows ({versions.supported}):"
            " its parameters were compared by their names of"
            f" {versions.newest}; what else has changed is not known"
        )
        yield from (each.text for each in versions.risks if version and version.release >= each.since)


def missing_to_do(versions: Versions, version: Version | None) -> str:
    """Return what to do about a parameter that a vehicle of this version does not have."""
    if versions.is_newer(version):
        return (
            f"update the station, or fly {versions.supported}:"
            f" {versions.title} {version} is newer than what it knows"
        )
    return f"install {versions.supported} as released, with all of its parameters"
