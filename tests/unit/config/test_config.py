"""A configuration is right, or refused with file, key and what would be right."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from gcs.cli.service.serve import load_here, make_link
from gcs.config.schema import Config, find, load, parse
from gcs.config.yaml_files import CONFIGURATIONS
from gcs.links.settings import Listen, SerialPort, TcpIn, TcpOut, UdpOut
from gcs.model.errors import ConfigError
from gcs.model.plan import Direction, YawPolicy

SHIPPED = CONFIGURATIONS.shipped()

SMALLEST = """
show_frame: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_amsl_m: 400.0}
links:
  - name: one
    listen: udpin://127.0.0.1:14540
    vehicles: [{id: a, system_id: 1}, {id: b, system_id: 2, charge: 2.0}]
formation: {radius_m: 10.0, height_m: 20.0}
"""

SECOND_LINK = {"name": "two", "listen": "udpin://127.0.0.1:15000", "vehicles": [{"id": "c", "system_id": 9}]}


def changed(change: Callable[[dict[str, Any]], object]) -> str:
    """SMALLEST after `change`, as YAML."""
    raw = yaml.safe_load(SMALLEST)
    change(raw)
    text: str = yaml.safe_dump(raw)
    return text


def refusal(text: str) -> str:
    with pytest.raises(ConfigError) as refused:
        parse(text, "my.yaml")
    stated = str(refused.value)
    assert stated.startswith("my.yaml: ")
    return stated


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_configuration_that_comes_with_the_package_loads(path: Path) -> None:
    config = load(path)
    assert len(config.ids) == len(set(config.ids)) >= 4
    assert config.plan.formation.radius_m == config.formation.radius_m


def test_both_shipped_configurations_are_found_by_name() -> None:
    assert {"demo", "px4-sitl"} <= {path.stem for path in SHIPPED}
    for name in ("demo", "demo.yaml", "configs/demo.yaml"):
        assert find(name).stem == "demo"


def test_path_of_a_user_file_is_used_as_given(tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(SMALLEST, encoding="utf-8")
    assert find(str(own)) == own
    assert load(own).ids == ("a", "b")


def test_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml.*demo.*px4-sitl"):
        find("nowhere.yaml")
    with pytest.raises(ConfigError, match="no such file"):
        find("elsewhere/demo.yaml")


def test_a_link_may_have_places_of_every_kind_and_250_vehicles() -> None:
    def change(raw: dict[str, Any]) -> None:
        raw["record"] = {"folder": "runs"}
        raw["formation"] = {"radius_m": 30.0, "height_m": 50.0}
        raw["links"][0] |= {
            "listen": [
                "udpin://10.0.0.1:14540",
                "udpout://localhost:14580",
                "tcpin://10.0.0.1:5760",
                "tcpout://10.0.0.2:5760",
                "serial:///dev/ttyUSB0:57600",
            ],
            "vehicles": {"count": 250},
            "forward": ["udp://127.0.0.1:14550", {"url": "udp://127.0.0.1:14551", "read_only": False}],
            "signing": {"key_file": "keys/one", "link_id": 3},
            "streams": {"position_hz": 10.0, "others_hz": 2.0},
        }

    config = parse(changed(change), "my.yaml")
    (link,) = config.links
    assert link.places == (
        Listen("10.0.0.1", 14540),
        UdpOut("127.0.0.1", 14580),
        TcpIn("10.0.0.1", 5760),
        TcpOut("10.0.0.2", 5760),
        SerialPort("/dev/ttyUSB0", 57600),
    )
    assert [each.read_only for each in link.forward] == [True, False]

    assert len(config.ids) == 250
    assert config.record is not None
    assert Config.model_validate(config.model_dump()) == config


def test_single_forwarding_station_need_not_be_a_list() -> None:
    config = parse(changed(lambda raw: raw["links"][0].update(forward="udp://127.0.0.1:14550")), "my.yaml")
    assert [each.address for each in config.links[0].forward] == [("127.0.0.1", 14550)]


def test_several_links_may_carry_the_same_system_ids() -> None:
    second = {**SECOND_LINK, "vehicles": [{"id": "c", "system_id": 1}]}
    config = parse(changed(lambda raw: raw["links"].append(second)), "my.yaml")
    assert config.ids == ("a", "b", "c")


def test_the_smallest_configuration_gets_the_documented_defaults() -> None:
    config = parse(SMALLEST, "my.yaml")
    assert [vehicle.charge for vehicle in config.fleet] == [1.0, 2.0]
    assert config.links[0].places == (Listen("127.0.0.1", 14540),)
    assert config.tick_rate_hz == 20.0
    assert config.plan.orbit.direction is Direction.COUNTERCLOCKWISE
    assert config.plan.yaw.policy is YawPolicy.HELD
    assert (config.frame.latitude_deg, config.frame.heading_deg) == (47.0, 0.0)


def test_a_range_of_system_ids_is_written_out() -> None:
    text = changed(
        lambda raw: raw["links"][0].update(
            vehicles={"first_system_id": 7, "count": 3, "id_pattern": "fox-{system_id}"}
        )
    )
    config = parse(text, "my.yaml")
    assert config.ids == ("fox-7", "fox-8", "fox-9")
    assert [vehicle.system_id for vehicle in config.fleet] == [7, 8, 9]


def test_several_links_carry_one_fleet_and_may_repeat_system_ids() -> None:
    config = parse(changed(lambda raw: raw["links"].append(SECOND_LINK)), "my.yaml")
    assert config.ids == ("a", "b", "c")


BAD: dict[str, tuple[Callable[[dict[str, Any]], object], tuple[str, ...]]] = {
    "an unknown key": (lambda raw: raw.update(colour="red"), ("colour", "red")),
    "an unknown key deep inside": (
        lambda raw: raw.update(control={"law": {"speed_kmh": 9}}),
        ("control.law.speed_kmh", "9"),
    ),
    "a start place of no vehicle": (
        lambda raw: raw.update(preflight={"start_places": {"z": {"x_m": 0, "y_m": 0}}}),
        ("preflight.start_places", "there is no vehicle z"),
    ),
    "two start places in one": (
        lambda raw: raw.update(
            preflight={"start_places": {"a": {"x_m": 1, "y_m": 2}, "b": {"x_m": 1.1, "y_m": 2}}}
        ),
        ("start_places: a and b have the same place",),
    ),
    "half a start place": (
        lambda raw: raw.update(preflight={"start_places": {"a": {"x_m": 1}}}),
        ("preflight.start_places.a.y_m", "required"),
    ),
    "a start place in words": (
        lambda raw: raw.update(preflight={"start_places": {"a": {"x_m": "1", "y_m": 2}}}),
        ("preflight.start_places.a.x_m = '1'",),
    ),
    "a start place on another continent": (
        lambda raw: raw.update(preflight={"start_places": {"a": {"x_m": 1e6, "y_m": 2}}}),
        ("preflight.start_places.a.x_m = 1000000.0",),
    ),
    "a list of start places": (
        lambda raw: raw.update(preflight={"start_places": [{"x_m": 1, "y_m": 2}]}),
        ("preflight.start_places",),
    ),
    "no limit for a rotation": (
        lambda raw: raw.update(preflight={"rotation_max_deg": 90}),
        ("preflight.rotation_max_deg = 90",),
    ),
    "no limit for a shift": (
        lambda raw: raw.update(preflight={"shift_max_m": 0}),
        ("preflight.shift_max_m = 0",),
    ),
    "an empty battery that is enough": (
        lambda raw: raw.update(preflight={"battery_min": 0.0}),
        ("preflight.battery_min = 0.0",),
    ),
    "a check that is switched off by another name": (
        lambda raw: raw.update(preflight={"skip": ["clock"]}),
        ("line 14: preflight.skip", "unknown key"),
    ),
    "a missing section": (lambda raw: raw.pop("formation"), ("formation", "required")),
    "a missing key": (lambda raw: raw["formation"].pop("height_m"), ("formation.height_m", "required")),
    "text where a number belongs": (
        lambda raw: raw["formation"].update(radius_m="wide"),
        ("formation.radius_m", "wide"),
    ),
    "a list where a number belongs": (
        lambda raw: raw["formation"].update(radius_m=[1]),
        ("formation.radius_m",),
    ),
    "nothing where a number belongs": (
        lambda raw: raw["formation"].update(radius_m=None),
        ("formation.radius_m",),
    ),
    "NaN": (lambda raw: raw["formation"].update(radius_m=float("nan")), ("formation.radius_m", "nan")),
    "infinity": (lambda raw: raw["formation"].update(height_m=float("inf")), ("formation.height_m", "inf")),
    "a negative radius": (
        lambda raw: raw["formation"].update(radius_m=-3.0),
        ("formation.radius_m", "greater than 0"),
    ),
    "a latitude beyond the pole": (
        lambda raw: raw["show_frame"].update(latitude_deg=91),
        ("show_frame.latitude_deg", "91"),
    ),
    "a listen address without a port": (
        lambda raw: raw["links"][0].update(listen="udpin://127.0.0.1"),
        ("links.0.listen", "udpin://127.0.0.1"),
    ),
    "a listen address of another kind": (
        lambda raw: raw["links"][0].update(listen="http://127.0.0.1:14540"),
        ("links.0.listen", "http", "serial://DEVICE:BAUD"),
    ),
    "port 0": (
        lambda raw: raw["links"][0].update(listen="udpin://127.0.0.1:0"),
        ("links.0.listen", "ports 0"),
    ),
    "ports beyond the last": (
        lambda raw: raw["links"][0].update(listen="udpin://127.0.0.1:65530", ports=8),
        ("links.0", "65537", "65535"),
    ),
    "no ports": (lambda raw: raw["links"][0].update(ports=0), ("links.0.ports", "0")),
    "a transport we do not have": (
        lambda raw: raw["links"][0].update(transport="pigeon"),
        ("links.0.transport", "pigeon"),
    ),
    "an API port that does not exist": (lambda raw: raw.update(api={"port": 70000}), ("api.port", "70000")),
    "a system id above 250": (
        lambda raw: raw["links"][0]["vehicles"][0].update(system_id=251),
        ("system_id", "251"),
    ),
    "a range that runs over 250": (
        lambda raw: raw["links"][0].update(vehicles={"first_system_id": 248, "count": 8}),
        ("line 8: links.0.vehicles.count = 8", "255", "at most 250"),
    ),
    "an id with a space": (
        lambda raw: raw["links"][0]["vehicles"][0].update(id="my drone"),
        ("id", "my drone"),
    ),
    "a system id twice": (
        lambda raw: raw["links"][0]["vehicles"][1].update(system_id=1),
        ("links.0", "system id 1", "twice"),
    ),
    "an id twice": (lambda raw: raw["links"][0]["vehicles"][1].update(id="a"), ("vehicle a", "twice")),
    "a pattern that names all the same": (
        lambda raw: raw["links"][0].update(vehicles={"count": 3, "id_pattern": "same"}),
        ("vehicle same", "twice"),
    ),
    "a link twice": (
        lambda raw: raw["links"].append({**SECOND_LINK, "name": "one"}),
        ("link one", "twice"),
    ),
    "two links on one port": (
        lambda raw: raw["links"][0].update(ports=600) or raw["links"].append(SECOND_LINK),
        ("one", "two", "127.0.0.1:15000"),
    ),
    "a listen address that would have to be looked up": (
        lambda raw: raw["links"][0].update(listen="tcpout://radio.local:5760"),
        ("links.0.listen", "radio.local", "in numbers"),
    ),
    "a baud rate of nothing": (
        lambda raw: raw["links"][0].update(listen="serial:///dev/ttyUSB0:0"),
        ("links.0.listen", "baud"),
    ),
    "several ports of a serial device": (
        lambda raw: raw["links"][0].update(listen="serial:///dev/ttyUSB0:57600", ports=2),
        ("links.0", "ports = 2"),
    ),
    "nowhere to listen": (lambda raw: raw["links"][0].update(listen=[]), ("links.0.listen",)),
    "one place twice": (
        lambda raw: raw["links"][0].update(listen=["serial:///dev/a:57600", "serial:///dev/a:9600"]),
        ("links.0", "twice"),
    ),
    "a forward of another kind": (
        lambda raw: raw["links"][0].update(forward=["tcp://127.0.0.1:14550"]),
        ("links.0.forward.0", "tcp://127.0.0.1:14550"),
    ),
    "a forward to a port that is none": (
        lambda raw: raw["links"][0].update(forward=[{"url": "udp://127.0.0.1:0"}]),
        ("links.0.forward.0", "port 0"),
    ),
    "a forward to ourselves": (
        lambda raw: raw["links"][0].update(forward=["udp://127.0.0.1:14540"]),
        ("one", "udp://127.0.0.1:14540", "ourselves"),
    ),
    "a signing link id above a byte": (
        lambda raw: raw["links"][0].update(signing={"key_file": "k", "link_id": 256}),
        ("links.0.signing.link_id", "256"),
    ),
    "two links that sign alike": (
        lambda raw: (
            raw["links"][0].update(signing={"key_file": "k"})
            or raw["links"].append({**SECOND_LINK, "signing": {"key_file": "k"}})
        ),
        ("one", "two", "link_id 0"),
    ),
    "recording to nowhere": (lambda raw: raw.update(record={}), ("record.folder", "required")),
    "a stream rate below 0": (
        lambda raw: raw["links"][0].update(streams={"position_hz": -1.0}),
        ("links.0.streams.position_hz", "-1"),
    ),
    "more MAVSDK than a process bears": (
        lambda raw: raw["links"].extend(
            {
                "name": f"l{index}",
                "listen": f"udpin://127.0.0.1:{16000 + index}",
                "vehicles": {"count": 70, "id_pattern": f"l{index}-{{system_id}}"},
            }
            for index in range(8)
        ),
        ("17 MAVSDK instances", "16"),
    ),
    "no links": (lambda raw: raw.update(links=[]), ("links", "at least one")),
    "a fence upside down": (
        lambda raw: raw.update(control={"safety": {"fence": {"height_min_m": 9.0, "height_max_m": 8.0}}}),
        ("height_max_m = 8.0", "above height_min_m"),
    ),
    "a take-off below the fence": (
        lambda raw: raw.update(operation={"takeoff_height_m": 2.0}),
        ("operation.takeoff_height_m", "3.0"),
    ),
    "a law faster than the limits": (
        lambda raw: raw.update(control={"law": {"speed_m_s": 9.0}}),
        ("control.law", "horizontal_m_s = 8.0"),
    ),
    "a centre faster than the limits": (
        lambda raw: raw.update(control={"law": {"center_speed_max_m_s": 9.0}}),
        ("control.law", "horizontal_m_s = 8.0"),
    ),
    "a sphere below the fence": (
        lambda raw: raw["formation"].update(height_m=11.0),
        ("height_m = 11.0", "at least 13.0 m"),
    ),
    "an orbit faster than the centre": (
        lambda raw: raw.update(orbit={"speed_m_s": 5.0}),
        ("speed_m_s = 5.0", "at most"),
    ),
    "an orbit too tight": (
        lambda raw: raw.update(orbit={"radius_m": 3.0, "speed_m_s": 2.5}),
        ("radius_m = 3.0", "at least 6.3 m"),
    ),
    "a target beyond the fence": (
        lambda raw: raw.update(target={"x_m": 4000.0}),
        ("position", "4000", "within 288.0 m"),
    ),
    "ticks too slow": (lambda raw: raw.update(tick_rate_hz=1.0), ("tick_rate_hz", "1.0")),
    "a setpoint watchdog too patient": (
        lambda raw: raw.update(setpoint_timeout_s=0.5),
        ("setpoint_timeout_s", "0.5"),
    ),
    "an action that does not exist": (
        lambda raw: raw.update(operation={"setpoint_loss_action": "panic"}),
        ("operation.setpoint_loss_action", "panic"),
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_impossible_setting_is_refused_with_file_key_and_value(what: str) -> None:
    change, named = BAD[what]
    stated = refusal(changed(change))
    assert all(part in stated for part in named), stated


@pytest.mark.parametrize(
    ("line", "reported"),
    [
        ("  raduis_m: 15.0", "line 4: formation.raduis_m = 15.0: unknown key; did you mean radius_m?"),
        ("  radius_m: yes", "line 4: formation.radius_m = 'yes': a number is needed"),
        ("  radius_m: true", "line 4: formation.radius_m = true: a number is needed"),
        ("  radius_m: on", "line 4: formation.radius_m = 'on': a number is needed"),
        ("  radius_m: '15'", "line 4: formation.radius_m = '15': a number is needed"),
        ("  radius_m:", "line 4: formation.radius_m = nothing: a number is needed"),
        ("  radius_m: 1e308", "line 4: formation.radius_m = 1e308: at most 10000"),
        ("  radius_m: 1e999", "line 4: formation.radius_m = 1e999: a number is needed, neither infinite"),
        ("  radius_m: 0.01", "line 4: formation.radius_m = 0.01: at least"),
        ("  radius_m: 500", "line 4: formation.radius_m = 500: at most 48.5 m"),
        ("  radius_m: {a: 1}", "line 4: formation.radius_m: a number is needed"),
    ],
)
def test_formation_is_refused_with_line_key_value_and_hint(line: str, reported: str) -> None:
    stated = refusal(f"{SIX}formation:\n{line}\n  height_m: 25.0\n")
    assert reported in stated, stated
    assert not [words for words in FOREIGN if words in stated], stated


def test_refusal_of_an_enormous_radius_does_not_name_the_fence() -> None:
    """Before: fence.height_max_m too small for formation.radius_m = 1e+308: at least inf m."""
    fence = "control: {safety: {fence: {height_min_m: 4.0, height_max_m: 5.0, distance_max_m: 4.0}}}\n"
    found = refusal(f"{SIX}formation: {{radius_m: 1e308, height_m: 25.0}}\n{fence}")
    assert "formation.radius_m = 1e308: at most 10000" in found
    assert "inf" not in found


SIX = """show_frame: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_amsl_m: 400.0}
links: [{name: one, listen: "udpin://127.0.0.1:14540", ports: 6, vehicles: {count: 6}}]
"""
FORMED = "formation: {radius_m: 10.0, height_m: 25.0}\n"
FOREIGN = (
    "Input should",
    "Extra inputs",
    "Field required",
    "tuple",
    "Settings",
    "pattern",
    "instance",
    "valid",
)
"""Words of a library, or of Python, that tell a reader nothing."""


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        (SIX.replace("ports: 6", "ports: 5") + FORMED, "line 2: links.0.ports = 5: 1 port for all, or one"),
        (SIX + "formation:\n", "line 3: formation = nothing: a section is needed, with radius_m, height_m"),
        (SIX + "formation: 7\n", "line 3: formation = 7: a section is needed, with radius_m, height_m"),
        (SIX.replace("{count: 6}", "6") + FORMED, "line 2: links.0.vehicles = 6: a list is needed"),
        (
            SIX.replace("{count: 6}", "[{id: my drone, system_id: 1}]") + FORMED,
            "id = 'my drone': 1 to 32 of A-Z",
        ),
        (
            SIX.replace("{count: 6}", "{cuont: 6}") + FORMED,
            "links.0.vehicles.cuont = 6: unknown key; did you mean count?",
        ),
        (SIX + FORMED + "links: []\n", "line 4: key 'links' is there twice"),
        (SIX + FORMED + "contorl: {}\n", "line 4: contorl: unknown key; did you mean control?"),
        (
            SIX + FORMED + "control:\n  safety:\n    fence: {height_max_m: 5.0}\n",
            "line 6: control.safety.fence.height_max_m = 5.0: too small for formation.radius_m = 10: at",
        ),
        (
            SIX + FORMED + "control: {safety: {fence: {distance_max_m: 6.0}}}\n",
            "control.safety.fence.distance_max_m = 6.0: too small for formation.radius_m = 10: at least",
        ),
        (
            SIX + FORMED + "operation: {setpoint_loss_action: panic}\n",
            "operation.setpoint_loss_action = 'panic': one of 'descend', 'hold', 'land' or 'return'",
        ),
        (
            SIX + FORMED + "operation: {pilot_takes_over: 3}\n",
            "pilot_takes_over = 3: true or false is needed",
        ),
        (SIX + FORMED + "shows: {folder: 3}\n", "shows.folder = 3: a file or folder is needed"),
        (SIX.replace("ports: 6", "ports: 6.5") + FORMED, "links.0.ports = 6.5: a whole number is needed"),
    ],
)
def test_invalid_configuration_has_its_own_message(text: str, reported: str) -> None:
    stated = refusal(text)
    assert reported in stated, stated
    assert not [words for words in FOREIGN if words in stated], stated


def test_yes_and_no_are_booleans_where_the_schema_wants_one() -> None:
    config = parse(SIX + FORMED + "operation: {pilot_takes_over: no, require_parameters: yes}\n", "my.yaml")
    assert (config.operation.pilot_takes_over, config.operation.require_parameters) == (False, True)


def test_a_folder_given_as_a_file_and_another_encoding_are_named(
    tmp_path: Path,
) -> None:
    (tmp_path / "mine.yaml").write_bytes(b"# one\nabout: Z\xfcrich\n")
    with pytest.raises(ConfigError, match=r"it is a folder: name the file in it, such as .*mine\.yaml"):
        find(str(tmp_path))
    with pytest.raises(ConfigError, match=r"line 2: byte 14 \(0xfc\) is not UTF-8: save the file as UTF-8"):
        load(tmp_path / "mine.yaml")


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        (
            ("127.0.0.1:14540", "203.0.113.9:14540"),
            "line 2: links.0.listen = 'udpin://203.0.113.9:14540': this",
        ),
        (
            ("formation:", "api: {host: 203.0.113.9}\naccess: {tokens_file: t.json}\nformation:"),
            "line 3: api.host = '203.0.113.9': this computer has no such address",
        ),
    ],
)
def test_listen_address_of_another_host_is_refused(
    tmp_path: Path, change: tuple[str, str], reported: str
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text((SIX + FORMED).replace(*change))
    assert load(file).ids  # to judge a record by, another computer's will do
    with pytest.raises(ConfigError) as refused:
        load_here(str(file))
    assert reported in str(refused.value)
    assert load_here("demo")[0].ids


def test_every_problem_is_listed_without_whole_sections() -> None:
    def spoil(raw: dict[str, Any]) -> None:
        raw["formation"].update(radius_m=-1.0)
        raw["show_frame"].update(latitude_deg=100.0)

    stated = refusal(changed(spoil))
    assert "formation.radius_m" in stated
    assert "show_frame.latitude_deg" in stated
    assert "{'" not in refusal(changed(lambda raw: raw.update(links=[])))


@pytest.mark.parametrize(
    ("added", "named"),
    [
        ("formation: {radius_m: 1.0, height_m: 2.0}", "'formation' is there twice"),
        ("api: {port: 1, port: 2}", "'port' is there twice"),
        ("api: [", "not YAML"),
        ("? [a, b]\n: 1", "line 9: column 3: a key must be a word"),
        ("tick_rate_hz: 2020-99-99", "line 9: tick_rate_hz = '2020-99-99': a number is needed"),
        ("tick_rate_hz: !!bool maybe", "line 9: column 15: !!bool: tags are not allowed"),
        ("tick_rate_hz: !!timestamp soon", "!!timestamp: tags are not allowed"),
        ("tick_rate_hz: !!python/object:os.system x", "tags are not allowed"),
        ("tick_rate_hz: " + "[" * 1000, "line 9: column 46: nested deeper than 32 levels"),
        ("1: 2", "line 9: 1 = 2: unknown key; known here: show_frame, links, formation"),
    ],
)
def test_text_that_is_no_valid_mapping_is_refused(added: str, named: str) -> None:
    assert named in refusal(f"{SMALLEST}\n{added}\n")


def test_a_repeated_key_is_refused_with_its_line() -> None:
    assert "line 2: key 'a' is there twice" in refusal("a: 1\na: 2\n")


@pytest.mark.parametrize("text", ["", "just text", "- a\n- list\n", "42"])
def test_what_is_not_a_mapping_is_refused(text: str) -> None:
    assert "a mapping is needed" in refusal(text)


def test_a_file_that_is_missing_or_unreadable_is_refused_by_name(tmp_path: Path) -> None:
    missing, garbled = tmp_path / "missing.yaml", tmp_path / "garbled.yaml"
    garbled.write_bytes(b"\xff\xfe\x00formation")
    for path in (missing, garbled, tmp_path):
        with pytest.raises(ConfigError) as refused:
            load(path)
        assert str(refused.value).startswith(f"{path}: cannot be read")


def test_settings_cannot_be_changed_after_loading() -> None:
    config = parse(SMALLEST, "my.yaml")
    with pytest.raises(ValueError, match="frozen"):
        config.formation.radius_m = 1.0


OWN = "vehicles: [{id: d1, system_id: 1}, {id: d2, system_id: 2, autopilot: px4}]"


@pytest.mark.parametrize(
    ("link", "autopilots"),
    [
        ("vehicles: {count: 2}", ["px4", "px4"]),
        ("autopilot: ardupilot, vehicles: {count: 2}", ["ardupilot", "ardupilot"]),
        (f"autopilot: ardupilot, {OWN}", ["ardupilot", "px4"]),
    ],
)
def test_vehicle_has_the_autopilot_of_its_link_or_its_own(link: str, autopilots: list[str]) -> None:
    config = parse(SIX.replace("vehicles: {count: 6}", link).replace("6", "2") + FORMED, "my.yaml")
    assert [vehicle.autopilot for vehicle in config.fleet] == autopilots
    assert [profile.name for profile in config.links[0].autopilots] == autopilots
    again = Config.model_validate_json(config.model_dump_json())  # as a record keeps it
    assert again.fleet == config.fleet


def test_unknown_autopilot_is_refused_with_those_that_are_known() -> None:
    text = SIX.replace("vehicles", "autopilot: betaflight, vehicles") + FORMED
    with pytest.raises(ConfigError, match=r"autopilot = 'betaflight': .*px4.*ardupilot"):
        parse(text, "my.yaml")


@pytest.mark.parametrize(("transport", "number"), [("native", 254), ("mavsdk", 245)])
def test_link_knows_the_system_id_of_its_station(transport: str, number: int) -> None:
    """ArduCopter counts the heartbeats of one system id only."""
    text = SIX.replace("name: one", f"name: one, transport: {transport}") + FORMED
    (settings,) = parse(text, "my.yaml").links
    assert settings.station_id == number
    assert make_link(settings, parse(text, "my.yaml"))._station_id == number
