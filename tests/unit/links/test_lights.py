"""Colours as MAVLink messages, what of them leaves first, and the share of a link that they may use."""

import random
from itertools import pairwise

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from gcs.links.address_book import Addresses
from gcs.links.features import LightSettings
from gcs.links.lights import LightSender, most_urgent
from gcs.links.link import Counters
from gcs.links.send_budget import Budget
from gcs.links.sender import Outbox
from gcs.links.settings import Listen, SerialPort, extra_bytes_per_s
from gcs.mavlink.codec import encode
from gcs.mavlink.lights import LightDriver, light_messages
from tests.support.kept_ports import KeptPorts

IDS = np.array([3, 250])
COLOUR = np.array([(255, 128, 1), (0, 0, 0)], np.uint8)


def decoded(driver: LightDriver) -> list[ardupilotmega.MAVLink_message]:
    """What pymavlink reads of the frames for `COLOUR`."""
    message_id, messages = light_messages(driver, IDS, COLOUR, time_s=12.5)
    frames = encode(message_id, messages, np.zeros(2, np.uint8))
    parser = ardupilotmega.MAVLink(None)
    raws = [frames.data[at, : frames.length[at]].tobytes() for at in range(2)]
    return [parser.decode(bytearray(raw)) for raw in raws]


def test_led_control_has_three_custom_bytes() -> None:
    one, other = decoded(LightDriver.LED_CONTROL)
    assert (one.get_type(), one.target_system, one.instance, one.pattern) == ("LED_CONTROL", 3, 255, 255)
    assert (one.custom_len, one.custom_bytes[:4]) == (3, [255, 128, 1, 0])
    assert (other.target_system, other.custom_len, set(other.custom_bytes)) == (250, 3, {0})


def test_key_value_names_its_vehicle_and_is_exact() -> None:
    one, other = decoded(LightDriver.DEBUG_KEY_VALUE)
    assert (one.get_type(), one.name, int(one.value)) == ("NAMED_VALUE_FLOAT", "rgb3", 0xFF8001)
    assert (other.name, other.value, one.time_boot_ms) == ("rgb250", 0.0, 12_500)


def test_actuators_take_colours_from_minus_one_to_one() -> None:
    one, other = decoded(LightDriver.ACTUATOR)
    assert (one.get_type(), one.command, one.target_system) == ("COMMAND_LONG", 187, 3)
    assert [one.param1, one.param2, one.param3] == pytest.approx([1.0, 128 / 127.5 - 1.0, 1 / 127.5 - 1.0])
    assert np.isnan([one.param4, one.param5, one.param6]).all(), "other actuators stay as they are"
    assert [other.param1, other.param2, other.param3, other.param7] == [-1.0, -1.0, -1.0, 0.0]


def test_changed_colours_leave_before_repeated_ones() -> None:
    changed = np.array([False, True, True, False, True])
    age_s = np.array([9.0, 0.3, 0.5, 1.0, 0.1])
    assert most_urgent(changed, age_s, 2.0).tolist() == [2, 1, 4, 0]
    assert most_urgent(~changed & False, -np.full(5, np.inf), 2.0).tolist() == []


def test_budget_keeps_its_rate_after_an_overdraft() -> None:
    budget, spent = Budget(1000.0), 0
    for tick in range(201):
        if budget.left_bytes(0.05 * tick) > 0:
            budget.spend(700)
            spent += 700
    assert 10_000 <= spent <= 10_000 + 250 + 700


def test_serial_port_leaves_most_of_its_rate_to_others() -> None:
    assert extra_bytes_per_s([SerialPort("/dev/ttyUSB0", 57_600)]) == 1440.0
    assert extra_bytes_per_s([Listen("127.0.0.1", 14540)]) == 100_000.0


def sender(count: int, bytes_per_s: float) -> tuple[LightSender, KeptPorts]:
    ports, ids = KeptPorts(), np.arange(1, count + 1)
    addresses = Addresses("bench", ids.tolist(), ports.address, Counters(), lambda: 0.0)
    outbox = Outbox(ports, addresses, Counters(), ids)
    return LightSender(LightSettings(driver=LightDriver.LED_CONTROL), outbox, Budget(bytes_per_s)), ports


def test_inexact_ticks_keep_the_rate_of_changing_colours() -> None:
    lights, ports = sender(1, 1e6)
    now_s, draw = 0.0, random.Random(3)
    while now_s < 60.0:
        lights.send(np.full((1, 3), int(now_s * 20) % 256, np.uint8), np.ones(1, np.bool_), now_s)
        now_s += draw.uniform(0.045, 0.065)
    assert 3.95 * 60 <= len(ports.left) <= 4.0 * 60 + 2


def test_unchanged_colour_is_repeated_in_case_it_was_lost() -> None:
    lights, ports = sender(1, 1e6)
    for tick in range(200):
        lights.send(np.full((1, 3), 7, np.uint8), np.ones(1, np.bool_), 0.05 * tick)
    assert len(ports.left) == 5, "at once, and every 2 s"


def test_small_budget_serves_every_vehicle_in_turn() -> None:
    """100 changing colours need 16 kB/s; with 2 kB/s each is sent less often, and none is left out."""
    lights, ports = sender(100, 2000.0)
    times_s: dict[int, list[float]] = {}
    for tick in range(400):
        colour = np.full((100, 3), tick // 5 % 256, np.uint8)
        lights.send(colour, np.ones(100, np.bool_), 0.05 * tick)
        for raw in ports.left:
            times_s.setdefault(raw[10], []).append(0.05 * tick)
        ports.left.clear()
    assert sorted(times_s) == list(range(1, 101))
    longest_s = max(after - before for times in times_s.values() for before, after in pairwise(times))
    assert longest_s < 2.5
    assert lights.sent * 20 <= 2000 * 20 + 500 + 41


def test_colours_that_never_left_are_counted() -> None:
    lights, _ = sender(1, 1e6)
    for tick in range(201):  # ten seconds at 20 Hz, another colour each tick, 4 of them leave a second
        lights.send(np.full((1, 3), tick + 1, np.uint8), np.ones(1, np.bool_), 0.05 * tick)
    assert lights.sent == 41
    assert (lights.dropped, lights.sent + lights.dropped) == (159, 200), "the last one waits"
    for tick in range(201, 220):
        lights.send(np.full((1, 3), 200, np.uint8), np.ones(1, np.bool_), 0.05 * tick)
    assert lights.dropped == 160, "a colour that waits is not lost"
