"""A diagnostics bundle: documents in one file, without secrets of the config, and bounded."""

import gzip
import io
import json
import tarfile
from collections.abc import Callable, Collection, Iterable, Iterator
from datetime import UTC, datetime
from typing import Final

from gateway.config.reading.masking import MASK
from gateway.operator.operations.answers.support import Document
from gateway.version import __version__

#: The most characters of one document, and of all.
MOST_OF_ONE: Final = 8 * 1024 * 1024
MOST_OF_ALL: Final = 32 * 1024 * 1024
#: A shorter secret is hidden where the config has it, and not elsewhere: too many other words would have it in them.
_SHORTEST: Final = 4
#: How many characters are packed at a time, or a line if it is longer.
_PART: Final = 64 * 1024
_CUT: Final = "\n[cut here: the bundle has room for no more]\n"

_ABOUT: Final = """\
A diagnostics bundle of modbus-gateway {version}, made at {at} on {host}.

Passwords, tokens and private keys of the config are not in it, and neither are its comments. What is in it: names and
addresses of lines, devices, clients and users, and {values}.

"""
_WITH_TRACE: Final = "what passed on the lines in the last minutes, with the values of the process (trace.jsonl)"
_WITHOUT_TRACE: Final = "no values of the process"
TRACE: Final = "trace.jsonl"


class Bundle:
    """Collects documents. `secrets` are hidden in all of them when it is packed."""

    def __init__(self) -> None:
        self._texts: dict[str, list[str]] = {}
        #: Why documents are missing, by name.
        self.missing: dict[str, str] = {}
        self._room = MOST_OF_ALL

    @property
    def names(self) -> Collection[str]:
        """The documents that it has."""
        return self._texts.keys()

    def add(self, document: Document) -> None:
        """Add a document, or a part of one; what there is no room for is cut off."""
        if document.missing:
            self.missing[document.name] = document.missing
            return
        parts = self._texts.setdefault(document.name, [])
        if parts and parts[-1] is _CUT:
            return
        room = min(self._room, MOST_OF_ONE - sum(map(len, parts)))
        parts.append(document.text[:room])
        self._room -= len(parts[-1])
        if len(document.text) > room:
            parts.append(_CUT)

    def add_all(self, documents: Iterable[Document]) -> None:
        """Add several."""
        for each in documents:
            self.add(each)

    def packed(self, secrets: Collection[str], host: str, at: float, pause: Callable[[], None] = lambda: None) -> bytes:
        """Pack all of it into one file (.tar.gz), made `at` this Unix time. Blocks; `pause` is called between parts."""
        when = datetime.fromtimestamp(at, UTC)
        folder = f"modbus-gateway-{host}-{when:%Y%m%dT%H%M%SZ}"
        hidden = _forms(secrets)
        packed = io.BytesIO()
        with (
            gzip.GzipFile(fileobj=packed, mode="wb", mtime=int(at)) as stream,
            tarfile.open(fileobj=stream, mode="w") as archive,
        ):
            for name, text in {"README.txt": self._about(host, when), **self._joined()}.items():
                content = bytearray()
                for part in _in_parts(text):
                    content += _without(part, hidden).encode(errors="replace")
                    pause()
                entry = tarfile.TarInfo(f"{folder}/{name}")
                entry.size, entry.mtime, entry.mode = len(content), int(at), 0o600
                archive.addfile(entry, io.BytesIO(content))
        return packed.getvalue()

    def _joined(self) -> dict[str, str]:
        return {name: "".join(parts) for name, parts in self._texts.items()}

    def _about(self, host: str, when: datetime) -> str:
        at = when.isoformat(timespec="seconds").removesuffix("+00:00") + "Z"
        values = _WITH_TRACE if TRACE in self._texts else _WITHOUT_TRACE
        rows = [f"{name}: {len(text)} characters" for name, text in self._joined().items()]
        rows += [f"{name}: missing: {why}" for name, why in self.missing.items()]
        return _ABOUT.format(version=__version__, at=at, host=host, values=values) + "\n".join(rows) + "\n"


def _forms(secrets: Collection[str]) -> list[str]:
    """List the ways in which secrets may be written, the longest first."""
    lines = {line.strip() for each in secrets for line in each.splitlines()}
    long = {each for each in lines if len(each) >= _SHORTEST}
    in_json = {json.dumps(each, ensure_ascii=ascii_only)[1:-1] for each in long for ascii_only in (False, True)}
    return sorted(long | in_json, key=len, reverse=True)


def _in_parts(text: str) -> Iterator[str]:
    """Cut a text into parts that end with a line, where there are lines: none of them cuts a secret."""
    at = 0
    while at < len(text):
        end = text.find("\n", at + _PART) + 1 or len(text)
        yield text[at:end]
        at = end


def _without(text: str, hidden: Iterable[str]) -> str:
    for each in hidden:
        text = text.replace(each, MASK)
    return text
