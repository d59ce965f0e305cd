"""The control socket for the other commands of this program. One JSON object a line in each direction.

{"verb": "status"}   {"version": "0.1.0", "ok": true, "status": {...}}
{"verb": "which"}    {"version": "0.1.0", "ok": true, "config": "/etc/modbus-gateway/gateway.toml"}
{"verb": "reload"}   {"version": "0.1.0", "ok": false, "problems": ["gateway.toml:3:8: error: ..."]}
{"verb": "unit", "unit": "silo-1"}
                     {"version": "0.1.0", "ok": true, "unit": {"unit": 41, "points": [...], ...}}
{"verb": "request", "unit": 41, "pdu": "03 00 00 00 02"}
                     {"version": "0.1.0", "ok": true, "unit": 41, "pdu": "03 04 45 9C 3D 51", "elapsed_ms": 12.5}
{"verb": "forget", "device": "silo-1"}
                     {"version": "0.1.0", "ok": true, "forgotten": {"unit": 1, "was_at": [5], ...}, ...}
{"verb": "bench", "line": "hall-a", "seconds": 60}
                     {"version": "0.1.0", "ok": true, "bench": {"expected_per_second": 12.1, ...}}
{"verb": "times", "unit": "silo-1"}
                     {"version": "0.1.0", "ok": true, "times": {"unit": 41, "rows": [...], ...}}
{"verb": "scan", "line": "hall-a"}
                     {"version": "0.1.0", "ok": true, "progress": {"asked": 12, "of": 245, ...}}, and so on until
                     {"version": "0.1.0", "ok": true, "found": [{"unit": 7, "result": "answers", ...}]}

What is asked for in several answers ends when who has asked leaves.

The client may be another version: keys may differ, and `version` says why.
"""

import asyncio
import json
import socket
import stat
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable, Mapping
from contextlib import aclosing, asynccontextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Final

from gateway import __version__
from gateway.errors import WrongQuestion
from gateway.events import ControlClosed, Emit, PartFailed
from gateway.operator.units import IsThere

#: Longest request, in bytes.
LONGEST_REQUEST: Final = 64 * 1024
#: How long a connection may be idle, in seconds.
PATIENCE: Final = 60.0
#: Concurrent connections.
MOST_CONNECTIONS: Final = 16

#: A verb: takes the request, returns what is added to `ok` in the answer. Dataclasses become objects.
Verb = Callable[[Mapping[str, Any], IsThere], Awaitable[dict[str, Any]]]
#: The same with several answers, one after the other, for as long as somebody takes them.
Stream = Callable[[Mapping[str, Any], IsThere], AsyncGenerator[dict[str, Any], None]]
Verbs = Mapping[str, Verb | Stream]


@asynccontextmanager
async def control_open(path: Path, verbs: Verbs, emit: Emit) -> AsyncIterator[None]:
    """Serve `verbs` at `path` inside the context. A failure to do so is only logged."""
    conversations: set[asyncio.Task[None]] = set()

    def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(conversations) >= MOST_CONNECTIONS:
            writer.write(_line(_refuse(f"{MOST_CONNECTIONS} others are connected already; try again later")))
            writer.close()
            return
        conversation = asyncio.create_task(_serve_connection(reader, writer, verbs, emit), name="control")
        conversations.add(conversation)
        conversation.add_done_callback(conversations.discard)

    try:
        server = await asyncio.start_unix_server(connected, sock=_bound(path), limit=LONGEST_REQUEST)
    except OSError as error:
        emit(ControlClosed(str(path), error.strerror or str(error)))
        yield
        return
    try:
        yield
    finally:
        server.close()
        for conversation in conversations:
            conversation.cancel()
        _remove(path)


def _bound(path: Path) -> socket.socket:
    """Bind a socket to `path`, for its owner and group.

    Raises:
        OSError: it cannot be created.
    """
    _remove_stale_socket(path)
    sock = socket.socket(socket.AF_UNIX)
    try:
        sock.bind(str(path))
        path.chmod(0o660)
    except OSError:
        sock.close()
        raise
    return sock


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


def _remove_stale_socket(path: Path) -> None:
    """Remove the socket of a gateway that was killed.

    Raises:
        OSError: a gateway answers there, or it is not a socket.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        is_socket = stat.S_ISSOCK(path.lstat().st_mode)
    except FileNotFoundError:
        return
    if not is_socket:
        raise FileExistsError(0, "a file with this name exists and is not a socket")
    with socket.socket(socket.AF_UNIX) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
        else:
            raise FileExistsError(0, "another modbus-gateway answers there")


async def _serve_connection(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, verbs: Verbs, emit: Emit
) -> None:
    def is_there() -> bool:
        return not reader.at_eof()

    writer.transport.set_write_buffer_limits(0)  # `drain` waits until the kernel has the whole answer
    try:
        while line := await asyncio.wait_for(reader.readline(), PATIENCE):
            async with aclosing(_answers(line, is_there, verbs, emit)) as answers:
                async for answer in answers:
                    writer.write(answer)
                    await asyncio.wait_for(writer.drain(), PATIENCE)
                    await asyncio.sleep(0)  # let other tasks run: nothing above waits while more requests are buffered
                    if not is_there():
                        break
    except (OSError, TimeoutError, ValueError):  # disconnected, idle for too long, or a line that is too long
        writer.transport.abort()
    finally:
        writer.close()


async def _answers(line: bytes, is_there: IsThere, verbs: Verbs, emit: Emit) -> AsyncGenerator[bytes, None]:
    try:
        async with aclosing(_run_verb(line, is_there, verbs)) as answers:
            async for answer in answers:
                yield _line({"ok": True, **answer})
    except WrongQuestion as wrong:
        yield _line(_refuse(str(wrong)))
    except Exception as error:  # noqa: BLE001 - the error boundary of a request
        emit(PartFailed.of("control socket", error))
        yield _line(_refuse("a defect in the gateway; its log says more"))


async def _run_verb(line: bytes, is_there: IsThere, verbs: Verbs) -> AsyncGenerator[dict[str, Any], None]:
    """What a verb answers.

    Raises:
        WrongQuestion: there is no such verb, or it refuses the request.
    """
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        raise WrongQuestion("this is not JSON") from None
    verb = request.get("verb") if isinstance(request, dict) else None
    if not isinstance(verb, str) or verb not in verbs:
        raise WrongQuestion(f'"verb" must be one of {", ".join(verbs)}')
    answers = verbs[verb](request, is_there)
    if isinstance(answers, AsyncGenerator):
        async with aclosing(answers):
            async for answer in answers:
                yield answer
    else:
        yield await answers


def _refuse(why: str) -> dict[str, Any]:
    return {"ok": False, "error": why}


def _line(answer: Mapping[str, Any]) -> bytes:
    return json.dumps({"version": __version__, **answer}, default=_fields).encode() + b"\n"


def _fields(value: Any) -> dict[str, Any] | str:
    """A dataclass as its fields, for json: unlike `asdict` it copies nothing."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return str(value)
