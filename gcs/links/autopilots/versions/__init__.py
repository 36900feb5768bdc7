"""Versions of autopilots as data: names, units, defaults and meanings of parameters, and proofs; pure."""

from gcs.links.autopilots.versions.table import Form, Parameter, Proof, Versions, load
from gcs.links.autopilots.versions.version import Release, Version

__all__ = ["Form", "Parameter", "Proof", "Release", "Version", "Versions", "load"]
