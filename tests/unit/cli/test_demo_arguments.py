"""What `gcs demo` makes of its arguments."""

import argparse
from dataclasses import replace

import numpy as np
import pytest

from gcs.cli import options
from gcs.cli.demo import demo
from gcs.config.schema import Config
from gcs.links.settings import Listen
from gcs.model.errors import ConfigError, InvalidError
from gcs.preflight.parameters import settings_of


def config_of(*words: str) -> Config:
    parser = argparse.ArgumentParser()
    options.add_demo_arguments(parser)
    return demo.make_config(parser.parse_args(words))


def test_three_hundred_fly_on_two_links_with_equal_system_ids() -> None:
    config = config_of("--vehicles", "300", "--transport", "native", "--seconds", "160")
    ids = [[vehicle.system_id for vehicle in link.fleet] for link in config.links]
    assert ids == [list(range(1, 151))] * 2
    assert {link.transport for link in config.links} == {"native"}
    assert len(set(config.ids)) == 300
    first, second = (link.places[0] for link in config.links)
    assert isinstance(first, Listen)
    assert second == replace(first, first_port=first.first_port + 1)


@pytest.mark.parametrize(("count", "links"), [(2, [2]), (250, [250]), (251, [126, 125]), (1000, [250] * 4)])
def test_no_link_has_more_vehicles_than_system_ids(count: int, links: list[int]) -> None:
    config = config_of("--vehicles", str(count), "--transport", "native", "--seconds", "600")
    assert [len(link.fleet) for link in config.links] == links


def test_a_large_sphere_is_inside_its_fence_and_the_pads_are_too() -> None:
    config = config_of("--vehicles", "1000", "--transport", "native", "--seconds", "600")
    top_m = config.formation.height_m + config.formation.radius_m
    assert top_m < config.control.safety.fence.height_max_m
    assert np.min(settings_of(config)["GF_MAX_VER_DIST"]) >= top_m


@pytest.mark.parametrize("transport", ["native", "mavsdk"])
def test_mixed_fleet_alternates_and_notices_alike(transport: str) -> None:
    config = config_of("--autopilot", "mixed", "--transport", transport)
    assert [vehicle.autopilot for vehicle in config.fleet] == ["px4", "ardupilot"] * 4
    assert config.operation.setpoint_loss_s == 3.0
    required = settings_of(config)
    assert required["COM_OF_LOSS_T"] == 3.0
    assert np.size(required["RTL_ALT"]) == np.size(required["RTL_RETURN_ALT"]) == 8
    assert {vehicle.autopilot for vehicle in config_of("--autopilot", "ardupilot").fleet} == {"ardupilot"}
    with pytest.raises(ConfigError, match="one of px4, ardupilot, mixed"):
        config_of("--autopilot", "betaflight")


def test_a_law_that_there_is_not_is_named() -> None:
    with pytest.raises(InvalidError, match="law = rings: one of slots, article"):
        config_of("--law", "rings")
    with pytest.raises(ConfigError, match="a file's law flies with one station"):
        config_of("--law", "ring_law:Ring", "--stations", "2")


def test_default_transport_is_mavsdk_with_a_port_for_each() -> None:
    (link,) = config_of("--vehicles", "12").links
    assert (link.transport, link.ports, len(link.fleet)) == ("mavsdk", 12, 12)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--vehicles", "51"), "2 to 50 is possible; --transport native bears more"),
        (("--vehicles", "1001", "--transport", "native"), "2 to 1000 is possible"),
        (("--vehicles", "300", "--transport", "native", "--seconds", "60"), "at least 160 for 300"),
        (("--vehicles", "8", "--seconds", "120"), "at least 170 for 8"),
    ],
)
def test_impossible_arguments_are_refused_with_a_message(words: tuple[str, ...], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        config_of(*words)


def test_demo_sends_its_vehicles_to_tak() -> None:
    tak = config_of("--tak", "udp://127.0.0.1:6969").tak
    assert tak is not None
    assert ([receiver.at for receiver in tak.to], tak.callsign) == (["udp://127.0.0.1:6969"], "DEMO")
    with pytest.raises(ConfigError, match=r"--tak 127\.0\.0\.1:6969: udp://, tcp:// or tls://HOST:PORT is"):
        config_of("--tak", "127.0.0.1:6969")
