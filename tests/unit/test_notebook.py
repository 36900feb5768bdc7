"""The notebook as it is stored: small, and the same on every computer. `make docs` executes it."""

import json
import re
from base64 import b64decode
from itertools import chain
from pathlib import Path
from typing import Any

TEXT = (Path(__file__).parents[2] / "docs/examples/my_law.ipynb").read_text(encoding="utf-8")
NOTEBOOK: dict[str, Any] = json.loads(TEXT)
CODE = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
OUTPUTS: list[dict[str, Any]] = list(chain.from_iterable(cell["outputs"] for cell in CODE))


def test_every_cell_was_run_in_order_and_none_failed() -> None:
    assert [cell["execution_count"] for cell in CODE] == [*range(1, len(CODE) + 1)]
    assert {output["output_type"] for output in OUTPUTS} == {"display_data", "execute_result", "stream"}
    assert {output.get("name", "stdout") for output in OUTPUTS} == {"stdout"}


def test_nothing_of_a_computer_is_stored() -> None:
    assert NOTEBOOK["metadata"].keys() == {"kernelspec", "language_info"}
    assert NOTEBOOK["metadata"]["language_info"] == {"name": "python"}
    assert [cell["metadata"] for cell in NOTEBOOK["cells"] if cell["metadata"]] == []
    printed = [output.get("text", "") or output["data"].get("text/plain", "") for output in OUTPUTS]
    sources = [cell["source"] for cell in NOTEBOOK["cells"]]
    written = "\n".join("".join(each) for each in [*printed, *sources])
    assert re.findall(r"(?<![\w.)`])(?:/\w[\w.-]*/|[A-Z]:\\)\S*", written) == []


def test_its_pictures_are_small() -> None:
    pictures = [
        b64decode("".join(content))
        for output in OUTPUTS
        for kind, content in output.get("data", {}).items()
        if kind.startswith("image/")
    ]
    assert len(pictures) == 4
    assert sum(map(len, pictures)) <= 100_000
