"""The notebook as a page, executed anew at each build: a cell that fails ends the build.

MkDocs calls the functions `on_*` (mkdocs.yml). As a program it stores the outputs: `make notebook`.
"""

import os
from base64 import b64decode
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbclient import NotebookClient

DOCS: Final = Path(__file__).parents[1]
NOTEBOOK: Final = "examples/my_law.ipynb"
PAGE: Final = "examples/my_law.md"
PICTURES: Final = {"image/gif": "gif", "image/png": "png"}
LONGEST_S: Final = 600


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page and its pictures."""
    text = []
    for number, cell in enumerate(executed().cells):
        if cell.cell_type == "markdown":
            text.append(cell.source)
            continue
        text.append(_fenced(cell.source, "python"))
        for output in cell.outputs:
            kind, content = _shown(output)
            if kind in PICTURES:
                name = f"{Path(NOTEBOOK).stem}-{number}.{PICTURES[kind]}"
                files.append(File.generated(config, f"examples/{name}", content=b64decode(content)))
                text.append(f"![What cell {number} draws]({name})")
            else:
                text.append(_fenced(content, 'text title="Output"'))
    files.append(File.generated(config, PAGE, content="\n\n".join(text) + "\n"))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Point other pages' links to the notebook at its page."""
    return markdown if page.file.src_uri == PAGE else markdown.replace(f"{NOTEBOOK})", f"{PAGE})")


def executed() -> Any:
    """The notebook with what its cells print and draw now, run in an empty folder."""
    notebook = nbformat.read(DOCS / NOTEBOOK, as_version=4)
    with TemporaryDirectory() as folder:
        os.environ |= {"IPYTHONDIR": folder, "JUPYTER_RUNTIME_DIR": folder}
        NotebookClient(
            notebook,
            timeout=LONGEST_S,
            kernel_name="python3",
            record_timing=False,
            coalesce_streams=True,
            extra_arguments=["--IPKernelApp.log_level=ERROR"],
            resources={"metadata": {"path": folder}},
        ).execute()
    notebook.metadata.language_info = {"name": "python"}
    return notebook


def _shown(output: Any) -> tuple[str, str]:
    """The kind of an output, and its content."""
    if output.output_type == "stream":
        return "text/plain", output.text
    kind = next(kind for kind in (*PICTURES, "text/plain") if kind in output.data)
    return kind, output.data[kind]


def _fenced(text: str, language: str) -> str:
    return f"```{language}\n{text.rstrip()}\n```"


if __name__ == "__main__":
    nbformat.write(executed(), DOCS / NOTEBOOK)
