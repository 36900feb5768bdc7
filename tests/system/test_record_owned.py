"""A second service on the record of a running one is refused, and changes nothing. A restart is not."""

from pathlib import Path

import pytest
import yaml

from gcs.recording.audit_reader import rows
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, flying_config, service
from tests.support.started import run


@pytest.mark.soak
def test_second_service_on_a_record_is_refused(tmp_path: Path) -> None:
    first, second = (flying_config(1, free_ports(1), silence_s=2.0) for _ in range(2))
    record = tmp_path / "runs"
    raw = second.model_dump(mode="json") | {"record": {"folder": str(record)}}
    other = tmp_path / "other.yaml"
    other.write_text(yaml.safe_dump(raw), encoding="utf-8")
    with service(first, record) as (client, process):
        before = sorted(record.iterdir())
        refused = run("gcs", "serve", "--config", str(other), "--quiet", timeout_s=SOON_S)
        assert refused.returncode == 1
        assert f"another service (pid {process.pid} on " in refused.stderr
        assert f"writes this record: {record}" in refused.stderr
        assert sorted(record.iterdir()) == before
        assert client.health().alive
        process.kill()
        process.wait()
    with service(first, record) as (client, _):
        assert client.health().alive
        assert len(rows(record, "SELECT id FROM sessions")) == 2
