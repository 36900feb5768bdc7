"""Certificates with which the stations of a site know each other. Needs the extra `stations`."""

import os
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gcs.model.errors import ConfigError

VALID: Final = timedelta(days=3650)
SKEW: Final = timedelta(days=1)
"""The clocks of the hosts may differ by so much."""


def make_site_keys(folder: Path, hosts: dict[str, Sequence[str]]) -> list[Path]:
    """Write an authority, and for each station a certificate with its name and its hosts, and its key.

    The authority's key is not kept: to add a station make all of them anew.

    Args:
        folder: made if it is missing.
        hosts: by station, the names and addresses under which the others reach it.

    Returns: the files, readable for the user alone. Raises: ConfigError when one of them exists.
    """
    stations = list(hosts)
    files = [folder / "ca.pem"]
    files += [folder / f"{station}{end}" for station in stations for end in (".pem", ".key")]
    existing = [str(file) for file in files if file.exists()]
    if existing:
        raise ConfigError(f"{', '.join(existing)}: exists already, and is not overwritten")
    folder.mkdir(parents=True, exist_ok=True)
    authority_key = ec.generate_private_key(ec.SECP256R1())
    authority_name = _name("formation-gcs site")
    authority = (
        _begun(authority_name, authority_name, authority_key.public_key())
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(authority_key, hashes.SHA256())
    )
    _write(folder / "ca.pem", authority.public_bytes(serialization.Encoding.PEM))
    for station, reached in hosts.items():
        key = ec.generate_private_key(ec.SECP256R1())
        both = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        certificate = (
            _begun(_name(station), authority_name, key.public_key())
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(both), critical=False)
            .add_extension(x509.SubjectAlternativeName([_reached(host) for host in reached]), critical=False)
            .sign(authority_key, hashes.SHA256())
        )
        _write(folder / f"{station}.pem", certificate.public_bytes(serialization.Encoding.PEM))
        secret = key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
        _write(folder / f"{station}.key", secret)
    return files


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _begun(
    subject: x509.Name, issuer: x509.Name, public_key: ec.EllipticCurvePublicKey
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - SKEW)
        .not_valid_after(now + VALID)
    )


def _reached(host: str) -> x509.GeneralName:
    with suppress(ValueError):
        return x509.IPAddress(ip_address(host))
    return x509.DNSName(host)


def _write(file: Path, content: bytes) -> None:
    handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "wb") as stream:
        stream.write(content)
