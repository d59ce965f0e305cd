"""The operation `support`: what a running gateway can tell for a diagnostics bundle, and a whole one for the web page.

Whoever may not read a unit through the door that is used gets its requests and responses without their values.
"""

import asyncio
import json
import platform
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterable
from contextlib import aclosing
from itertools import islice
from time import sleep
from typing import Final, TypeVar

from gateway.clock.slices import turn
from gateway.clock.threads import in_thread
from gateway.config.reading.masking import secrets_in
from gateway.errors import ConfigError, WrongQuestion
from gateway.operator.fleet.inventory import tell_inventory
from gateway.operator.operations.answers.support import Document
from gateway.operator.operations.asked import ToExamine, ToList, ToSupport
from gateway.operator.operations.operation import Asker, Nothing
from gateway.operator.operations.parameters import fields_of
from gateway.operator.operator import Operator
from gateway.operator.past.events import last_events, told
from gateway.operator.status.metrics import read
from gateway.operator.status.status import tell_status
from gateway.operator.trace.facts import clocks, fact
from gateway.operator.trace.reader import what_is_seen, without_values
from gateway.operator.trace.unit_names import UnitNames
from gateway.runtime.reload import Reloader
from gateway.state.memory import state_folder
from gateway.tools.bundle import Bundle
from gateway.tools.doctor import examine
from gateway.tools.machine import documents_of_machine, without_advice
from gateway.trace.records import Record

#: How far back the trace goes, in seconds; how many records it has at most, and how many failures are told beside it.
TRACED: Final = 300.0
MOST_RECORDS: Final = 10_000
MOST_FAILURES: Final = 500
#: Records at a time, and characters in a part of a document: the lines do not wait for more.
_STEP: Final = 20
_PART: Final = 64 * 1024
#: The pause of the thread that packs a bundle after each part, in seconds: the lines need the interpreter.
_PAUSE: Final = 0.001
#: How long one document may take, in seconds.
PATIENCE: Final = 70.0
NO_TRACE: Final = "left out, as was asked"

A = TypeVar("A")

#: A document in its parts.
_Text = AsyncGenerator[str, None]


async def tell_all(operator: Operator, asked: ToSupport, asker: Asker) -> AsyncGenerator[Document, None]:
    """Yield each document in its parts; of one that cannot be made, why not. Nothing is sent on any line."""
    for name, text in _DOCUMENTS.items():
        if text in (_trace, _failures) and not asked.trace:
            yield Document(name, missing=NO_TRACE)
            continue
        try:
            async with asyncio.timeout(PATIENCE), aclosing(text(operator, asker)) as parts:
                async for part in parts:
                    yield Document(name, part)
            yield Document(name)  # there, even if it is empty
        except (WrongQuestion, ImportError) as error:
            yield Document(name, missing=str(error))
        except TimeoutError:
            yield Document(name, missing=f"it was not there within {PATIENCE:g} s")


async def make_bundle(operator: Operator, asked: ToSupport, asker: Asker) -> bytes:
    """Make a bundle of this gateway and its machine (.tar.gz)."""
    bundle, reloader = Bundle(), operator.reloader
    async with aclosing(tell_all(operator, asked, asker)) as documents:
        async for document in documents:
            bundle.add(document)
    at, troubles = operator.clock(), operator.running.troubles
    state = state_folder() if troubles is None else troubles.folder

    def packed() -> bytes:
        bundle.add_all(documents_of_machine(reloader.file, state, lambda: _check(reloader)))
        return bundle.packed(secrets_in(reloader.text), platform.node(), at, lambda: sleep(_PAUSE))

    return await in_thread("support", packed)


def _check(reloader: Reloader) -> str:
    """Return the problems of the config file as it is now. Blocks, as reading it does.

    Raises:
        OSError: it is not read; the message says why.
    """
    try:
        read = reloader.read(reloader.file, look_around=True)
    except ConfigError as error:
        raise OSError(str(error)) from error
    return "".join(f"{each}\n" for each in without_advice(read.problems)) or "no errors, no warnings\n"


def _in_json(tell: Callable[[Operator, A, Asker], Awaitable[object]], asked: A) -> Callable[[Operator, Asker], _Text]:
    """Make the document that an operation answers."""

    async def text(operator: Operator, asker: Asker) -> _Text:
        answer = await tell(operator, asked, asker)
        for part in _parts(await in_thread("support", _written, answer)):
            yield part

    return text


async def _events(operator: Operator, _asker: Asker) -> _Text:
    events = last_events(operator, ToList())
    for at in range(0, len(events), _STEP):
        told_events = (told(each, sees_bytes=False) for each in events[at : at + _STEP])
        yield "".join(f"{json.dumps(each, ensure_ascii=False)}\n" for each in told_events)
        await turn()


async def _metrics(operator: Operator, _asker: Asker) -> _Text:
    from gateway.observe.metrics import exposition  # noqa: PLC0415 - its library may not be installed

    families = await read(operator.running)
    text = (await in_thread("support", exposition, families)).decode()
    for part in _parts(text):
        yield part


async def _trace(operator: Operator, asker: Asker) -> _Text:
    ring, tell = operator.running.ring, _teller(operator, asker)
    if not ring.is_on:
        raise WrongQuestion("the config keeps no trace")
    end = ring.added
    number = max(ring.first, ring.number_at(clocks()[0] - TRACED), end - MOST_RECORDS)
    while number < end:
        records = ring.after(number, min(_STEP, end - number))
        if not records:
            return
        number = max(number, ring.first) + len(records)
        yield "".join(map(tell, records))
        await turn()


async def _failures(operator: Operator, asker: Asker) -> _Text:
    tell = _teller(operator, asker)
    failures = list(islice(operator.running.ring.failures(), MOST_FAILURES))
    for at in range(0, len(failures), _STEP):
        yield "".join(map(tell, failures[at : at + _STEP]))
        await turn()


def _teller(operator: Operator, asker: Asker) -> Callable[[Record], str]:
    """Make the function that writes a record as `trace --json` does; without values that the asker may not read."""
    clock, names = clocks(), UnitNames(operator.gateway)
    may_see = (lambda _: True) if asker.door == "control" else what_is_seen(operator.running, asker.host)

    def tell(record: Record) -> str:
        shown = fact(record, clock, names)
        return json.dumps(shown if may_see(record) else without_values(shown), ensure_ascii=False) + "\n"

    return tell


def _written(answer: object) -> str:
    return json.dumps(answer, default=fields_of, ensure_ascii=False, indent=1) + "\n"


def _parts(text: str) -> Iterable[str]:
    return (text[at : at + _PART] for at in range(0, len(text), _PART))


#: Each document of a running gateway, in their order.
_DOCUMENTS: Final[dict[str, Callable[[Operator, Asker], _Text]]] = {
    "status.json": _in_json(tell_status, Nothing()),
    "inventory.json": _in_json(tell_inventory, Nothing()),
    "doctor.json": _in_json(examine, ToExamine(ask=False)),
    "events.jsonl": _events,
    "metrics.txt": _metrics,
    "failures.jsonl": _failures,
    "trace.jsonl": _trace,
}
