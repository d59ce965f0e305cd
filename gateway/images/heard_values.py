"""Supplies mirrors and virtual units with what is heard of a device that only others ask.

    unknown ──heard──▶ fresh ──older than `stale`──▶ stale
       ▲                 │                             │
       └─ a write heard ─┴─────────────────────────────┘

A part is taken from one answer that has all of it. Nothing is ever asked, so nobody waits for a value.
"""

from collections.abc import Iterable
from math import inf

from gateway.images.places import Places
from gateway.images.polled_range import Part, Reader
from gateway.images.supply import Supply
from gateway.lines.monitor.monitor import HeardTransaction
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import Span
from gateway.registers.items import REGISTER, has_bits, items_read


class HeardValues(Supply):
    """Hands on the values of transactions that others have with a device."""

    silence = "was never heard, or too long ago"

    def __init__(self) -> None:
        super().__init__()
        self._heard: Places[Part] = Places(())
        self._written_at = -inf

    def change(self, come: Iterable[Part], gone: Iterable[Part], now: float) -> None:  # noqa: ARG002 - nothing is due
        """See Supply."""
        come = tuple(come)
        for part in come:
            part.is_awaited = False
        self._supply(come, gone)
        self._heard = Places((part.span, part) for part in self._parts)

    def changed(self, span: Span | None, now: float) -> None:
        """See Supply. No answer is on its way that reads could wait for."""
        self._written_at = now
        for part in self._forget(span):
            part.is_awaited = False

    def heard(self, transaction: HeardTransaction, now: float) -> None:
        """Take the values of a transaction, if they are sure; forget what it may have written.

        Values of a request from before the end of a write may be older than this.
        """
        asked, response = transaction.asked, transaction.response
        is_outdated = transaction.asked_at < self._written_at
        if transaction.may_have_written:
            self.changed(asked.write, now)
        if asked.read is None or response is None or not transaction.is_sure or is_outdated:
            return
        if not response.pdu[0] & EXCEPTION_BIT:
            self._take(asked.read, response.pdu, transaction.asked_at, now)

    def _take(self, span: Span, response: bytes, asked_at: float, now: float) -> None:
        """Hand the items of a response to the readers, but to those who have newer ones."""
        width = REGISTER if has_bits(span.area) else (len(response) - 2) // span.count
        try:
            items = items_read(span, response, width)
        except ValueError:  # it has another length
            return
        size = len(items) // span.count
        taken: dict[Reader, list[tuple[Part, bytes]]] = {}
        for part in self._heard.touched(span):
            if not span.has(part.span) or part.poll.width != width:
                continue
            if part.sampled_at is None or part.sampled_at <= asked_at:
                start, count = part.span.start - span.start, part.span.count
                taken.setdefault(part.reader, []).append((part, items[start * size : (start + count) * size]))
        for reader, parts in taken.items():
            reader.took(parts, now)
            for part, _ in parts:
                part.sampled(asked_at, self.writes)
