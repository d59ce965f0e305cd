"""The last failed requests to a unit, each with its story."""

import asyncio
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gateway.operator.trace.reader import what_is_seen
from gateway.operator.trace.stories import Story, sentences
from gateway.operator.trace.why import causes
from gateway.runtime.running import Running
from gateway.trace.pdus import request_in_words

#: At most this many failures are shown.
MOST_FAILURES: Final = 6


@dataclass(frozen=True, slots=True)
class Failure:
    """A failed request, and its story in sentences. `time` is in seconds since 1970.

    `not_sent` counts, by result, others that were not sent because of it or for the same reason.
    """

    time: float
    client: str
    asked: str
    story: str
    not_sent: tuple[tuple[str, int], ...] = ()


def failures(running: Running, unit: str, host: str) -> tuple[Failure, ...]:
    """List the last failures of the unit of this name that a reader at the address `host` may see, newest first.

    Raises:
        WrongQuestion: nothing is kept.
    """
    clock = asyncio.get_running_loop().time(), time.time()
    told = causes(running, unit, MOST_FAILURES, clock, what_is_seen(running, host))
    return tuple(_failure(story, not_sent) for story, not_sent in told)


def _failure(story: Story, not_sent: Mapping[str, int]) -> Failure:
    asked = request_in_words(bytes.fromhex(story["request"]))
    return Failure(story["received"], story["client"], asked, sentences(story), tuple(sorted(not_sent.items())))
