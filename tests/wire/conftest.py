import link_bench
import pytest

from gcs.links.direct.link import DirectLink
from gcs.links.mavsdk_link import MavsdkLink


@pytest.fixture(params=[MavsdkLink, DirectLink], ids=["mavsdk", "direct"])
def transport(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The test holds for both; its name says which is on. What `link_bench.a_link` makes is changed."""
    monkeypatch.setattr(link_bench, "chosen", request.param)
    name: str = "mavsdk" if request.param is MavsdkLink else "direct"
    return name
