"""The control socket: other commands of this program ask the daemon. One JSON object a line, each way.

{"verb": "status"}   {"ok": true, "status": {...}}
{"verb": "reload"}   {"ok": false, "problems": ["gateway.toml:3:8: error: ..."]}
"""

import asyncio
import json
import os
import socket
import stat
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

from gateway.events import ControlClosed, Emit

#: Longest request, in bytes.
LONGEST_REQUEST: Final = 64 * 1024
#: How long a connection may ask nothing, in seconds.
PATIENCE: Final = 60.0
#: Connections at a time.
MOST_CONNECTIONS: Final = 16

#: Where the socket of a system's gateway is.
SYSTEM_SOCKET: Final = Path("/run/modbus-gateway/control.sock")

#: What a verb does: takes the request, gives what is added to `ok` in the answer.
Verb = Callable[[Mapping[str, Any]], Awaitable[dict[str, Any]]]


def control_path(
    config: Path, environment: Mapping[str, str] = os.environ, *, is_root: bool = os.geteuid() == 0
) -> Path:
    """Where the control socket is when nobody says it."""
    if folder := environment.get("RUNTIME_DIRECTORY"):
        return Path(folder.split(":")[0]) / "control.sock"
    if is_root:
        return SYSTEM_SOCKET
    if folder := environment.get("XDG_RUNTIME_DIR"):
        return Path(folder) / "modbus-gateway" / "control.sock"
    return config.absolute().parent / "control.sock"


@asynccontextmanager
async def control_open(path: Path, verbs: Mapping[str, Verb], emit: Emit) -> AsyncIterator[None]:
    """In its context other processes can ask for `verbs` at `path`. Where that cannot be, it is told, and no more."""
    conversations: set[asyncio.Task[None]] = set()

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is None or len(conversations) >= MOST_CONNECTIONS:
            writer.close()
            return
        conversations.add(task)
        try:
            await _converse(reader, writer, verbs)
        finally:
            conversations.discard(task)
            writer.close()

    try:
        server = await asyncio.start_unix_server(converse, sock=_bound(path), limit=LONGEST_REQUEST)
    except OSError as error:
        emit(ControlClosed(str(path), error.strerror or str(error)))
        yield
        return
    try:
        yield
    finally:
        server.close()
        for task in conversations:
            task.cancel()
        _take_away(path)


def _bound(path: Path) -> socket.socket:
    """A socket at `path`, for its owner and group.

    Raises:
        OSError: there cannot be one.
    """
    _make_room(path)
    sock = socket.socket(socket.AF_UNIX)
    try:
        sock.bind(str(path))
        path.chmod(0o660)
    except OSError:
        sock.close()
        raise
    return sock


def _take_away(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


def _make_room(path: Path) -> None:
    """Take away what a gateway that was killed has left.

    Raises:
        OSError: somebody answers there, or it is something else.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        is_socket = stat.S_ISSOCK(path.lstat().st_mode)
    except FileNotFoundError:
        return
    if not is_socket:
        raise FileExistsError(0, "there is something else with this name")
    with socket.socket(socket.AF_UNIX) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
        else:
            raise FileExistsError(0, "another modbus-gateway answers there")


async def _converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, verbs: Mapping[str, Verb]) -> None:
    with suppress(OSError, TimeoutError, ValueError):  # gone, silent for too long, or a line that never ends
        while line := await asyncio.wait_for(reader.readline(), PATIENCE):
            answer = await _answer(line, verbs)
            writer.write(json.dumps(answer, default=str).encode() + b"\n")
            await asyncio.wait_for(writer.drain(), PATIENCE)


async def _answer(line: bytes, verbs: Mapping[str, Verb]) -> dict[str, Any]:
    try:
        request = json.loads(line)
    except ValueError:
        return {"ok": False, "error": "this is no JSON"}
    verb = request.get("verb") if isinstance(request, dict) else None
    if not isinstance(verb, str) or verb not in verbs:
        return {"ok": False, "error": f'"verb" must be one of {", ".join(verbs)}'}
    return {"ok": True, **await verbs[verb](request)}
