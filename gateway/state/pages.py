"""Pages of a file. Each has its records twice, with checksums: a worn flash card flips bits unnoticed.

Pages belong to commits, and commits to a generation, which begins with a snapshot of everything: commit 0. A page has
the size of a block of the usual file systems, and is never written a second time in its generation, so that no power
cut can damage what was there before.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from struct import Struct
from typing import Final, NamedTuple
from zlib import crc32

from gateway.errors import StateError

#: Bytes of a page, which consists of two equal copies.
PAGE: Final = 4096
_COPY: Final = PAGE // 2
#: Check sum of the rest; format; generation; commit; number of the page in the commit, and its pages; bytes of records.
_HEAD: Final = Struct("<I4sQQIIH")
_SUM: Final = 4
_FORMAT: Final = b"MBP1"
#: The longest record, in bytes, with the line feed behind it.
LONGEST: Final = _COPY - _HEAD.size


class Page(NamedTuple):
    """A page without its checksums. `content` are records, with a line feed behind each."""

    generation: int
    commit: int
    number: int
    pages: int
    content: bytes


@dataclass(slots=True)
class Found:
    """The pages that were read: by commit and index, of the newest generation.

    `half` pages have one damaged copy, and `lost` ones two.
    """

    generation: int = 0
    commits: dict[int, dict[int, Page]] = field(default_factory=dict)
    half: int = 0
    lost: int = 0

    def records(self, commit: int) -> list[bytes]:
        """Return the records of a commit that could be read."""
        pages = (page for _, page in sorted(self.commits[commit].items()))
        return [record for page in pages for record in page.content.split(b"\n")[:-1]]

    def is_whole(self, commit: int) -> bool:
        """Tell whether all pages of a commit could be read."""
        pages = self.commits.get(commit)
        return pages is not None and len(pages) == next(iter(pages.values())).pages


def encode(generation: int, commit: int, records: Iterable[bytes]) -> bytes:
    """Make the pages of a commit; records must not contain a line feed."""
    contents = list(_pack(records)) or [b""]
    return b"".join(
        _encode(Page(generation, commit, number, len(contents), content)) for number, content in enumerate(contents)
    )


def unused(count: int) -> bytes:
    """Make `count` pages without content, which differ from erased ones."""
    return _encode(Page(0, 0, 0, 0, b"")) * count


def read(*files: bytes) -> Found:
    """Read the pages of files that belong together.

    Raises:
        StateError: a later version has written them.
    """
    found = Found()
    for data in files:
        for start in range(0, len(data), PAGE):
            _add(found, [_decode(data[at : at + _COPY]) for at in (start, start + _COPY)])
    return found


def _add(found: Found, copies: list[Page | None]) -> None:
    sound = [page for page in copies if page is not None]
    if len(sound) < len(copies):
        found.half += len(sound)
        found.lost += not sound
    for page in sound:  # two different ones if power failed while the page was written
        if page.generation > found.generation:
            found.generation = page.generation
            found.commits.clear()
        if page.generation == found.generation and page.pages:
            found.commits.setdefault(page.commit, {})[page.number] = page


def _pack(records: Iterable[bytes]) -> Iterator[bytes]:
    content = b""
    for record in records:
        if len(content) + len(record) + 1 > LONGEST:
            yield content
            content = b""
        content += record + b"\n"
    if content:
        yield content


def _encode(page: Page) -> bytes:
    *numbers, content = page
    body = _HEAD.pack(0, _FORMAT, *numbers, len(content))[_SUM:] + content.ljust(LONGEST, b"\0")
    return (crc32(body).to_bytes(_SUM, "little") + body) * 2


def _decode(copy: bytes) -> Page | None:
    """Decode a copy of a page; None if it is damaged.

    Raises:
        StateError: a later version has written it.
    """
    if len(copy) < _COPY or crc32(copy[_SUM:]) != int.from_bytes(copy[:_SUM], "little"):
        return None
    _, form, generation, commit, number, pages, size = _HEAD.unpack_from(copy)
    if form != _FORMAT:
        raise StateError("it was written by a later version of modbus-gateway; move it away to start without it")
    return Page(generation, commit, number, pages, copy[_HEAD.size : _HEAD.size + size])
