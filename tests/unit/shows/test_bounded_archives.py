"""What a few bytes expand to is bounded before they are expanded: archives, records, answers, maps."""

import gzip
import io
import sqlite3
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from threading import Thread
from zlib import crc32

import pytest
import zstandard
from mcap.exceptions import McapError
from mcap.records import Chunk

from gcs.api.map_tiles import TileFile
from gcs.client.http import ANSWER_MAX_BYTES, Exchange
from gcs.model.errors import DrawingError, LinkError
from gcs.recording.mcap_reader import CHUNK_MAX_BYTES, CHUNK_RECORDS_MAX, messages
from gcs.shows.formats import parse_drawing
from gcs.shows.formats.archive import ENTRY_MAX_BYTES, SMALL_BYTES, Archive

MEMORY_MAX_BYTES = 100 << 20


@contextmanager
def little_memory() -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < MEMORY_MAX_BYTES
    finally:
        tracemalloc.stop()


def bomb(compression: int, entries: int = 1, size: int = ENTRY_MAX_BYTES) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", compression) as archive:
        for number in range(entries):
            archive.writestr(f"{number}.csv", b"0,0,0,0\n" + b" " * (size - 8))
    return content.getvalue()


def declaring(data: bytes, size: int) -> bytes:
    """The archive with another size of its first entry, in both of its places."""
    out = bytearray(data)
    for place in (22, data.index(b"PK\x01\x02") + 24):
        out[place : place + 4] = size.to_bytes(4, "little")
    return bytes(out)


@pytest.mark.alternates(1)
@pytest.mark.long
@pytest.mark.parametrize("compression", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_compressions_without_a_bound_are_refused(compression: int) -> None:
    """They expand all that they have been given, whatever number of bytes is asked for."""
    data = declaring(bomb(compression, size=8 * ENTRY_MAX_BYTES), 100)
    assert len(data) < 100_000
    with little_memory(), pytest.raises(DrawingError, match="deflate, or none, is read"):
        parse_drawing(data, "a.zip")


def test_many_entries_expand_no_further_than_one_may() -> None:
    data = bomb(zipfile.ZIP_DEFLATED, entries=20, size=SMALL_BYTES // 4)
    assert len(data) * 200 < 20 * SMALL_BYTES
    archive = Archive(data, "a.zip")
    with little_memory():
        assert sum(len(archive.read(f"{number}.csv")) for number in range(4)) == SMALL_BYTES
        with pytest.raises(DrawingError, match=r"4\.csv: with the entries before it more than"):
            archive.read("4.csv")


def test_a_false_size_of_an_entry_does_not_matter() -> None:
    data = declaring(bomb(zipfile.ZIP_DEFLATED), 100)
    with little_memory(), pytest.raises(DrawingError, match=r"cannot be read|needed"):
        parse_drawing(data, "a.zip")


def chunk(data: bytes, compression: str = "zstd", size: int | None = None) -> Chunk:
    packed = zstandard.compress(data) if compression == "zstd" else data
    return Chunk(compression, packed, 0, 0, crc32(data) or 1, len(data) if size is None else size)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: chunk(bytes(CHUNK_MAX_BYTES + 1)), f"a chunk of {CHUNK_MAX_BYTES + 1} bytes"),
        (lambda: chunk(bytes(300 << 20), size=100), "a chunk of 314572800 bytes, not 100"),
        (lambda: chunk(bytes(9 * CHUNK_RECORDS_MAX + 9)), f"more than {CHUNK_RECORDS_MAX} records"),
        (lambda: chunk(bytes(1000), "lz4"), "compression 'lz4'"),
    ],
)
def test_a_chunk_of_flight_data_expands_to_little(make: Callable[[], Chunk], says: str) -> None:
    made = make()
    assert len(made.data) < 100_000
    with little_memory(), pytest.raises(McapError, match=says):
        messages(made)


@pytest.mark.parametrize(
    ("compressed", "says"), [(True, "a compressed body"), (False, f"more than {ANSWER_MAX_BYTES} bytes")]
)
def test_a_service_cannot_fill_the_memory_of_its_client(compressed: bool, says: str) -> None:
    class Endless(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            if compressed:
                self.send_header("Content-Encoding", "gzip")
            self.end_headers()
            piece = gzip.compress(bytes(1 << 24)) if compressed else bytes(1 << 20)
            for _ in range(4 if compressed else 80):
                try:
                    self.wfile.write(piece)
                except OSError:  # the client has enough
                    return

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Endless) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            exchange = Exchange(f"http://127.0.0.1:{server.server_port}", None, None, None, 60.0)
            with closing(exchange), pytest.raises(LinkError, match=says):
                exchange.call("GET", "/api/v1/fleet")
        finally:
            server.shutdown()
            thread.join()


def test_an_attribution_of_a_map_is_cut_before_it_is_searched(tmp_path: Path) -> None:
    path = tmp_path / "a.mbtiles"
    with closing(sqlite3.connect(path)) as file, file:
        file.execute("CREATE TABLE metadata (name, value)")
        file.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)")
        file.execute("INSERT INTO tiles VALUES (0, 0, 0, x'00')")
        rows = {"format": "png", "minzoom": "0", "maxzoom": "0", "attribution": "<b>a</b>" + "<" * 5_000_000}
        file.executemany("INSERT INTO metadata VALUES (?, ?)", rows.items())
    opened = TileFile(path)
    opened.close()
    assert opened.attribution == "a" + "<" * 199
