"""A device of a monitor line: others ask it, and the gateway hears what it answers."""

from collections.abc import Callable
from typing import Final

from gateway.devices.device import Device, DeviceSettings
from gateway.errors import OnlyHeard
from gateway.events import Emit, discard_event
from gateway.lines.monitor.monitor import HeardTransaction
from gateway.lines.transaction import TakesTransactions, Transaction
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.request import Caller, Request
from gateway.trace.ring import Ring

#: Who has asked what is heard, in place of a client.
OTHERS: Final = Caller.without_address("heard")


class _Nothing(TakesTransactions):
    """Takes the transactions of a device that is never asked."""

    def submit(self, transaction: Transaction, now: float) -> None:  # noqa: ARG002 - see TakesTransactions
        raise AssertionError("a device of a monitor line is never asked")


class HeardDevice(Device):
    """A unit that only others ask: a Target that answers every request with 0A, and keeps what was heard of it."""

    def __init__(
        self,
        settings: DeviceSettings,
        emit: Emit = discard_event,
        ring: Ring | None = None,
        line_name: str = "",
    ) -> None:
        super().__init__(settings, _Nothing(), emit, ring, line_name)
        #: Takes what is heard of it for mirrors and virtual units; None if there are none.
        self.take: Callable[[HeardTransaction, float], None] | None = None

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:  # noqa: ARG002 - see Device
        """Fail the request with 0A: nothing is ever sent on a monitor line."""
        error = OnlyHeard(f"the gateway only listens on {self.line_name}")
        self.report_rejection(request, error)
        self._ring.refuse(request, error, now, line=self.line_name, name=self.name)
        request.fail(error)

    def heard(self, transaction: HeardTransaction, now: float) -> None:
        """Count what was heard, and keep the values of an answer that is sure."""
        self._count(transaction, now)
        asked, response = transaction.asked, transaction.response
        is_answer = response is not None and not response.pdu[0] & EXCEPTION_BIT
        if self.last_reads is not None and response is not None and is_answer and transaction.is_sure:
            self.last_reads.answered(asked, response.pdu, OTHERS, self.unit, transaction.asked_at, now)
        elif transaction.may_have_written:
            self.was_written(asked.write, now)
        if self.take is not None:
            self.take(transaction, now)

    def _count(self, transaction: HeardTransaction, now: float) -> None:
        asked, response = transaction.asked, transaction.response
        counts = self.counts[asked.function]
        counts.sent += 1
        if response is None:
            if transaction.unit == BROADCAST_UNIT:
                counts.broadcast += 1
            elif asked.is_answered:
                counts.timeout += 1
            else:
                counts.ok += 1
            return
        counts.responses += 1
        times, elapsed = self.counts.times[asked.function], transaction.answered_at - transaction.asked_at
        times.answered_at = transaction.answered_at
        times.answer.add(elapsed)
        if response.pdu[0] & EXCEPTION_BIT:
            counts.exception += 1
            self.counts.count_exception(response.pdu[1], 1, now)
        else:
            counts.ok += 1
            if transaction.is_sure:
                times.samples.add(asked.items, elapsed)
