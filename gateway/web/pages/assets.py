"""The files of the page that are the same for everybody. They are read once, at the start."""

import gzip
import hashlib
import mimetypes
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from aiohttp import web

FOLDER: Final = Path(__file__).parent / "static"
#: What the interpreter's own table does not know everywhere.
_TYPES: Final[Mapping[str, str]] = {".js": "text/javascript", ".svg": "image/svg+xml", ".woff2": "font/woff2"}
#: A file under a name with its version never changes.
_FOR_EVER: Final = "public, max-age=31536000, immutable"


@dataclass(frozen=True, slots=True)
class _Asset:
    content: bytes
    packed: bytes
    type: str
    version: str


class Assets:
    """The files by their paths in FOLDER. Reading them takes some milliseconds."""

    def __init__(self) -> None:
        files = (path for path in sorted(FOLDER.rglob("*")) if path.is_file())
        self._assets = {path.relative_to(FOLDER).as_posix(): _asset(path) for path in files}

    def address(self, name: str) -> str:
        """Return the address of a file; it changes with the content."""
        return f"/static/{name}?v={self._assets[name].version}"

    async def serve(self, request: web.Request) -> web.StreamResponse:
        """Handle `/static/{name}`."""
        asset = self._assets.get(request.match_info["name"])
        if asset is None:
            raise web.HTTPNotFound
        is_current = request.query.get("v") == asset.version
        headers = {
            "ETag": f'"{asset.version}"',
            "Cache-Control": _FOR_EVER if is_current else "no-cache",
            "Vary": "Accept-Encoding",
        }
        if request.headers.get("If-None-Match") == headers["ETag"]:
            return web.Response(status=304, headers=headers)
        is_packed = "gzip" in request.headers.get("Accept-Encoding", "") and len(asset.packed) < len(asset.content)
        if is_packed:
            headers["Content-Encoding"] = "gzip"
        headers["Content-Type"] = asset.type
        return web.Response(body=asset.packed if is_packed else asset.content, headers=headers)


def _asset(path: Path) -> _Asset:
    content = path.read_bytes()
    kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    if kind.startswith("text/"):
        kind += "; charset=utf-8"
    return _Asset(content, gzip.compress(content, mtime=0), kind, hashlib.sha256(content).hexdigest()[:16])
