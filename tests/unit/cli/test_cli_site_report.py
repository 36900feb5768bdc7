"""`gcs site report`: one page without any other host, and a KML that an independent reader understands."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from fastkml import KML, Document, Placemark

from gcs.areas.files.site_files import read_site, written
from gcs.areas.site import FlightSite, SiteArea
from gcs.cli.main import main
from gcs.config.schema import find, load
from gcs.config.yaml_files import shipped_folder
from gcs.flight.state.start_hashes import parameters_hash
from gcs.preflight.parameters import presumed_parameters

SHIPPED = read_site(shipped_folder() / "sites" / "lakeside.geojson")


class Outline(HTMLParser):
    """Tags that are open, and every address."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.headings: list[str] = []
        self._inside = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "action"}]
        assert tag not in {"script", "link", "img", "iframe"}
        self._inside = tag

    def handle_data(self, data: str) -> None:
        if self._inside == "h2":
            self.headings.append(data.strip())
            self._inside = ""


def parameters(folder: Path, loss_s: float = 1.0) -> Path:
    """All as demanded, but the time of d1 without setpoints."""
    demanded = presumed_parameters(load(find("lakeside")))
    rows = [
        {
            "vehicle": name,
            "parameter": parameter,
            "value": loss_s if (name, parameter) == ("d1", "COM_OF_LOSS_T") else value,
        }
        for name, values in demanded.items()
        for parameter, value in values.items()
    ]
    path = folder / "params.json"
    path.write_text(json.dumps({"rows": rows}))
    return path


def reported(folder: Path, *arguments: str, code: int = 0) -> str:
    target = folder / "report.html"
    assert main(["site", "report", *arguments, "-o", str(target)]) == code
    return target.read_text(encoding="utf-8")


def test_the_page_has_everything_and_asks_no_other_host(tmp_path: Path) -> None:
    page = reported(tmp_path, "lakeside", "lakeside", "--parameters", str(parameters(tmp_path)))
    outline = Outline()
    outline.feed(page)
    assert outline.addresses == []
    assert re.findall(r"https?://(?!www\.w3\.org/2000/svg)", page) == []
    assert outline.headings == [
        "Map",
        "Areas",
        "Volumes, computed both ways",
        "Vehicles",
        "Show lakeside",
        "Parameters",
        "Remote ID, and what else is sent and received",
    ]
    demanded = presumed_parameters(load(find("lakeside")))
    for words in (
        SHIPPED.digest,
        parameters_hash(sorted(demanded), demanded),
        "47.3973373, 8.5449979",
        "S_RZ = 4 m/s x 1 s",
        "fall with drag and wind",
        "wide enough",
        "1.5 kg",
        "It fits the areas, the limits and the frame.",
        "COM_OF_LOSS_T",
        "The configuration has none of it, and no Remote ID.",
    ):
        assert words in page, words


def test_remote_id_is_on_the_page(tmp_path: Path) -> None:
    section = (
        "remote_id: {operator_id: FIN87astrdge12k8, self_id: Evening show, geoid_m: 47.4, operator:"
        " {latitude_deg: 47.397, longitude_deg: 8.545, altitude_amsl_m: 488.0}}\n"
    )
    text = find("lakeside").read_text().replace("sites/", f"{shipped_folder() / 'sites'}/")
    (tmp_path / "a.yaml").write_text(text + section)
    page = reported(tmp_path, str(tmp_path / "a.yaml"))
    assert "FIN87astrdge12k8" in page
    assert "Evening show" in page


def test_differing_parameters_are_named_with_their_vehicles(tmp_path: Path) -> None:
    page = reported(tmp_path, "lakeside", "--parameters", str(parameters(tmp_path, 1.5)), code=1)
    assert "<span class=bad>1.5: not as demanded</span>: d1; 1: d2, d3, d4, d5, d6, d7, d8" in page
    assert "RTL_RETURN_ALT<br>d2" in page
    assert "missing</span>" in page


def test_a_show_that_does_not_fit_is_said_on_the_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = reported(tmp_path, "lakeside", "lighthouse", code=1)
    assert re.search(r"class=bad>line \d+: cue &#x27;[^<]* m are missing to the 45 m of the service", page)
    assert "NOT GOOD" in capsys.readouterr().out


def test_the_kml_is_understood_by_an_independent_reader(tmp_path: Path) -> None:
    reported(tmp_path, "lakeside", "lakeside")
    text = (tmp_path / "report.kml").read_text(encoding="utf-8")
    document = KML.from_string(text.partition("?>")[2]).features[0]
    assert isinstance(document, Document)
    assert document.name == SHIPPED.name
    assert document.extended_data is not None
    about = {data.name: data.value for data in document.extended_data.elements}  # type: ignore[union-attr]
    assert about["site_hash"] == SHIPPED.digest
    assert float(str(about["ground risk buffer, this fleet, PX4"]).removesuffix(" m")) > 20.0
    placemarks = [each for each in document.features if isinstance(each, Placemark)]
    assert [each.name for each in placemarks] == [area.name for area in SHIPPED.areas]
    for placemark, area in zip(placemarks, SHIPPED.areas, strict=True):
        ring = placemark.geometry.exterior.coords[:-1]  # type: ignore[union-attr]
        assert [(lat, lon) for lon, lat, *_ in ring] == list(area.corners)
    assert read_site(tmp_path / "report.kml") == SHIPPED


def test_names_of_files_are_text_only(tmp_path: Path) -> None:
    """A name with markup is shown as it is written, on the page and in the KML."""
    name = '<script>alert("x")</script> & co'
    first, *others = SHIPPED.areas
    renamed = SiteArea(first.kind, name, first.corners, first.height_min_m, first.height_max_m)
    site = FlightSite(name, (renamed, *others))
    (tmp_path / "a.kml").write_bytes(written(site, Path("a.kml")))
    text = find("lakeside").read_text().replace("sites/lakeside.geojson", "a.kml")
    (tmp_path / "a.yaml").write_text(text)
    page = reported(tmp_path, str(tmp_path / "a.yaml"))
    assert "<script" not in page
    assert "&lt;script&gt;alert" in page
    assert read_site(tmp_path / "report.kml").name == name


def test_a_wrong_output_is_an_error_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["site", "report", "lakeside", "-o", "report.pdf"]) == 2
    assert "report.pdf: a name that ends in .html is needed" in capsys.readouterr().err


def test_parameters_as_demanded_have_no_mark(tmp_path: Path) -> None:
    page = reported(tmp_path, "lakeside", "--parameters", str(parameters(tmp_path)))
    assert "not as demanded" not in page.lower()


def test_a_parameter_that_was_not_read_is_not_good(tmp_path: Path) -> None:
    path = parameters(tmp_path)
    rows = [row for row in json.loads(path.read_text())["rows"] if row["parameter"] != "GF_ACTION"]
    path.write_text(json.dumps({"rows": rows}))
    page = reported(tmp_path, "lakeside", "--parameters", str(path), code=1)
    assert "<li class=bad>GF_ACTION: d1, d2, d3, d4, d5, d6, d7, d8" in page


def test_vehicles_that_were_not_weighed_are_not_good(tmp_path: Path) -> None:
    text = find("lakeside").read_text()
    (tmp_path / "sites").mkdir()
    (tmp_path / "sites" / "lakeside.geojson").write_bytes(written(SHIPPED, Path("a.geojson")))
    path = tmp_path / "unweighed.yaml"
    path.write_text(re.sub(r"    impact:\n      airframe: .*\n", "", text))
    page = reported(tmp_path, str(path), "--parameters", str(parameters(tmp_path)), code=1)
    assert "control.safety.impact.airframe is not set: weigh and measure the vehicles" in page


def test_a_parameter_of_other_versions_is_shown_in_its_place(tmp_path: Path) -> None:
    path = parameters(tmp_path)
    rows = [row for row in json.loads(path.read_text())["rows"] if row["parameter"] != "MAN_OVERRIDE_SPD"]
    rows += [{"vehicle": f"d{row}", "parameter": "COM_RC_OVERRIDE", "value": 3} for row in range(1, 9)]
    path.write_text(json.dumps({"rows": rows}))
    page = reported(tmp_path, "lakeside", "--parameters", str(path))
    assert "<td>COM_RC_OVERRIDE in its place: 3<td>" in page
    assert "not read" not in page
