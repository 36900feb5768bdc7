"""Certificates of a site: one authority, and for each station a name and hosts."""

import stat
from ipaddress import ip_address
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID

from gcs.bus.keys import make_site_keys
from gcs.bus.settings import key_files
from gcs.model.errors import ConfigError


def test_each_station_has_a_certificate_with_its_name_and_hosts(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    files = make_site_keys(folder, {"north": ["10.0.0.1", "north.example"], "south": ["::1"]})
    assert sorted(path.name for path in files) == [
        *("ca.pem", "north.key", "north.pem", "south.key", "south.pem")
    ]
    assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}
    assert set(files) == {*key_files(folder, "north"), *key_files(folder, "south")}
    authority, north, south = (
        x509.load_pem_x509_certificate((folder / f"{name}.pem").read_bytes())
        for name in ("ca", "north", "south")
    )
    for certificate in (north, south):
        certificate.verify_directly_issued_by(authority)
    assert north.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value == "north"
    names = north.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.IPAddress) == [ip_address("10.0.0.1")]
    assert names.get_values_for_type(x509.DNSName) == ["north.example"]


def test_existing_keys_are_not_overwritten(tmp_path: Path) -> None:
    make_site_keys(tmp_path, {"north": ["127.0.0.1"]})
    before = (tmp_path / "north.key").read_bytes()
    with pytest.raises(ConfigError, match=r"north\.key: exists already, and is not overwritten"):
        make_site_keys(tmp_path, {"north": ["127.0.0.1"], "south": ["127.0.0.1"]})
    assert (tmp_path / "north.key").read_bytes() == before
    assert not (tmp_path / "south.key").exists()
