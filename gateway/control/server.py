"""The control socket for the other commands of this program. One JSON object a line in each direction.

{"verb": "status"}   {"version": "0.1.0", "ok": true, "status": {...}}
{"verb": "unit", "unit": "silo-1"}
                     {"version": "0.1.0", "ok": true, "unit": {"unit": 41, "points": [...], ...}}
{"verb": "unit"}     {"version": "0.1.0", "ok": false, "error": "..."}

The verbs, their parameters and their results are those of all operations (`operator/operations/table.py`). Some have
several answers, one after the other, and then {"ok": true, "end": true}; they stop early if the client is gone.
`messages.py` makes these objects and reads them.

The client may be another version: keys may differ, and `version` says why.
"""

import asyncio
import json
import socket
import stat
from collections.abc import AsyncGenerator, AsyncIterator, Mapping
from contextlib import aclosing, asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

from gateway.clock.beside import end
from gateway.clock.slices import turn
from gateway.control.messages import END, WRITE, answer_of, line_of
from gateway.errors import WrongQuestion
from gateway.events import ControlClosed, Emit, PartFailed
from gateway.operator.operations.operation import Asker, Operation
from gateway.operator.operations.parameters import read_parameters
from gateway.operator.operations.table import BY_NAME
from gateway.operator.operations.writing import written
from gateway.operator.operator import Operator
from gateway.operator.values.requests import AT_CONTROL
from gateway.runtime.garbage import no_collection
from gateway.version import __version__

#: Longest request, in bytes.
LONGEST_REQUEST: Final = 64 * 1024
#: How long a connection may be idle, in seconds.
PATIENCE: Final = 60.0
#: Concurrent connections.
MOST_CONNECTIONS: Final = 16

#: Operations by name.
Operations = Mapping[str, Operation[Any, Any]]


@asynccontextmanager
async def control_open(
    path: Path, operator: Operator, emit: Emit, operations: Operations = BY_NAME
) -> AsyncIterator[None]:
    """Serve the operations of `operator` at `path` inside the context. If that fails, it is only logged."""
    conversations: set[asyncio.Task[None]] = set()

    def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(conversations) >= MOST_CONNECTIONS:
            writer.write(_refusal(f"{MOST_CONNECTIONS} others are connected already; try again later"))
            writer.close()
            return
        conversation = asyncio.create_task(
            _serve_connection(reader, writer, operator, operations, emit), name="control"
        )
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
        _remove(path)
        await end(*conversations)


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
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, operator: Operator, operations: Operations, emit: Emit
) -> None:
    asker = Asker(AT_CONTROL, lambda: not reader.at_eof())

    writer.transport.set_write_buffer_limits(0)  # `drain` waits until the kernel has the whole answer
    try:
        while line := await asyncio.wait_for(reader.readline(), PATIENCE):
            async with aclosing(_answers(line, operator, asker, operations, emit)) as answers:
                async for answer in answers:
                    writer.write(answer)
                    await asyncio.wait_for(writer.drain(), PATIENCE)
                    await asyncio.sleep(0)  # let other tasks run: nothing above waits while more requests are buffered
                    if not asker.is_there():
                        break
    except (OSError, TimeoutError, ValueError):  # disconnected, idle for too long, or a line that is too long
        writer.transport.abort()
    finally:
        writer.close()


async def _answers(
    line: bytes, operator: Operator, asker: Asker, operations: Operations, emit: Emit
) -> AsyncGenerator[bytes, None]:
    try:
        request = _request(line)
        operation = _operation(request, operations)
        await operation.load()
        await turn()
        async with aclosing(_lines(operation, carry_out(request, operator, asker, operations))) as answers:
            async for answer in answers:
                yield answer
    except WrongQuestion as wrong:
        yield _refusal(str(wrong))
    except Exception as error:  # noqa: BLE001 - the error boundary of a request
        emit(PartFailed.of("control socket", error))
        yield _refusal("a defect in the gateway; its log says more")


async def _lines(
    operation: Operation[Any, Any], answers: AsyncGenerator[Mapping[str, Any], None]
) -> AsyncGenerator[bytes, None]:
    """Write the answers of an operation as lines."""
    async with aclosing(answers):
        if operation.is_large:
            with no_collection():
                line = await _written({"ok": True, **await anext(answers)})
            yield line
            return
        async for answer in answers:
            yield await _written({"ok": True, **answer})
        if operation.is_repeated:
            yield _line({"ok": True, **END})


def _request(line: bytes) -> Mapping[str, Any]:
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        raise WrongQuestion("this is not JSON") from None
    return request if isinstance(request, dict) else {}


def _operation(request: Mapping[str, Any], operations: Operations) -> Operation[Any, Any]:
    verb = request.get("verb")
    operation = operations.get(verb) if isinstance(verb, str) else None
    if operation is None:
        raise WrongQuestion(f'"verb" must be one of {", ".join(operations)}')
    return operation


async def carry_out(
    request: Mapping[str, Any], operator: Operator, asker: Asker, operations: Operations = BY_NAME
) -> AsyncGenerator[Mapping[str, Any], None]:
    """Carry out one operation, and yield its answers.

    Raises:
        WrongQuestion: there is no such operation, or it cannot be carried out.
    """
    operation = _operation(request, operations)
    asked = read_parameters(operation.parameters, request)
    if operation.is_repeated:
        async with aclosing(operation.answers(operator, asked, asker)) as answers:
            async for answer in answers:
                yield answer_of(operation, answer)
    else:
        yield answer_of(operation, await operation.answer(operator, asked, asker))


def _refusal(why: str) -> bytes:
    return _line({"ok": False, "error": why})


async def _written(answer: Mapping[str, Any]) -> bytes:
    """Write an answer as a line."""
    writing = written({"version": __version__, **answer}, WRITE)
    del answer
    return await writing + b"\n"


def _line(answer: Mapping[str, Any]) -> bytes:
    return line_of({"version": __version__, **answer})
