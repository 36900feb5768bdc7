"""`gcs demo`, as a user runs it: the whole story, judged by the vehicles' true states."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gcs.cli.main import main
from tests.support.audit_rows import commands
from tests.support.machine import free_ports


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["nmea", "gpsd", "cot", "mavlink"])
def test_demo_follows_a_target_that_reports_itself(kind: str) -> None:
    command = [sys.executable, "-m", "gcs", "demo", "--target", kind, "--vehicles", "4", "--seconds", "170"]
    command += ["--json", "--api-port", "0", "--port-base", str(free_ports(4))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures["landed"] == 4
    assert figures["separation_violations"] == 0
    assert figures["target_followed_s"] >= 30.0
    assert figures["target_median_m"] < 0.8
    assert figures["target_p95_m"] < 1.5


@pytest.mark.soak
def test_demo_flies_its_script_and_its_record_proves_it(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "gcs", "demo", "--vehicles", "8", "--seconds", "170", "--json"]
    command += ["--api-port", "0", "--port-base", str(free_ports(8)), "--record", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures["landed"] == figures["vehicles"] == 8
    assert figures["separation_violations"] == 0
    assert figures["min_separation_m"] > 2.0
    assert figures["obstacle_penetrations"] == 0
    for part in ("before", "after"):
        assert figures[f"energy_ratio_{part}"] <= 1.002
        assert figures[f"nearest_ratio_{part}"] >= 0.97
    assert figures["radius_error_m"] < 1.0
    assert figures["orbit_radius_error_m"] < 0.8
    assert figures["target_moved_m"] > 40.0
    assert figures["setpoints_sent"] > 8 * 20 * 100
    for positions in ("true", "estimated"):
        report = tmp_path / f"{positions}.json"
        assert main(["report", str(tmp_path), "--positions", positions, "--report", str(report)]) == 0
        judged = json.loads(report.read_text())
        assert (judged["verdict"], judged["flew"], judged["remarks"]) == ("kept", 8, [])
        assert judged["based_on"] == f"{positions} positions"
    assert [command.action for command in commands(tmp_path)] == ["start", "stop"]
    assert {outcome for command in commands(tmp_path) for outcome, _ in command.outcomes.values()} == {"done"}
