"""One request on a line, ours or another client's, and the responses that may still come for it."""

from typing import Final

from gateway.compiler import mypyc_attr
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame
from gateway.modbus.functions import response_size
from gateway.modbus.pdu import RequestPdu
from gateway.modbus.scan import NEVER, Expected

#: A foreign request to a unit that we send none to, and the suspicion that the line is shared, are kept this long, in
#: seconds.
FOREIGN_LASTS: Final = 300.0


@mypyc_attr(free_list_len=1)
class Exchange(Expected):
    """A request to `unit`, and its responses: from `answers_from` (None: any unit), at the place `since` or later."""

    __slots__ = (
        "asked_at", "end_place", "ends_at", "had_arrived", "held", "is_answered", "is_any", "is_awaited", "owed",
        "place", "transaction", "unit",
    )  # fmt: skip

    def __init__(
        self, unit: int, answers_from: int | None, asked: RequestPdu, place: int, transaction: Transaction | None = None
    ) -> None:
        super().__init__(answers_from, asked, place)
        self.unit = unit
        #: The place where it was sent, or where another client's ended, in the bytes of the line.
        self.place = place
        #: The transaction that has sent it; None for a request of an earlier line or of another client.
        self.transaction = transaction
        #: Whether it stands for several requests of other clients, so that any response with its function may answer
        #: it.
        self.is_any = False
        #: When its last character was on the line; up to what time `owed` responses may come.
        self.asked_at = 0.0
        self.ends_at = 0.0
        self.owed = 1
        #: Whether the next fitting response is taken for its own, and whether one was.
        self.is_awaited = False
        self.is_answered = False
        #: The place from which on it is not awaited any more.
        self.end_place = NEVER
        #: How many of its sendings the connection may hold back, because nothing was received; whether all of it had
        #: arrived at the other end when its late window began.
        self.held = 0
        self.had_arrived = True

    @property
    def sender(self) -> Transaction:
        """The transaction that has sent it.

        Raises:
            AttributeError: another client or an earlier line has sent it.
        """
        if self.transaction is None:
            raise AttributeError("another client has sent it, or an earlier line")
        return self.transaction

    def finish(self, place: int) -> None:
        """Stop awaiting it from this place on. Frames from before it may still follow."""
        self.is_awaited = False
        self.end_place = min(self.end_place, place)

    def join(self, earlier: "Exchange") -> None:
        """Stand also for another client's earlier request with the same function."""
        self.is_any = True
        self.owed += earlier.owed

    def is_copy(self, frame: Frame) -> bool:
        """Tell whether `frame` is a copy of the request."""
        return frame.unit == self.unit and frame.pdu == self.asked.data

    def accepts(self, frame: Frame) -> bool:
        """Tell whether `frame` is a response to it."""
        if self.transaction is not None:
            return self.transaction.accepts(frame)
        return self.answers_from in (None, frame.unit) and self.asked.accepts(frame.pdu)

    def forbids(self, other: Transaction) -> bool:
        """Tell whether a response to this exchange could be taken for the response to `other`.

        A late exception response fits any quantity, so only unit and function count. Before and after the change of an
        address the unit must owe nothing: the response would come from the new address. A request to address 0 that
        expects a response must be the only one on the line.
        """
        if not (self.owed and other.expects_answer):
            return False
        if other.unit == BROADCAST_UNIT:
            return True
        is_same_unit = self.unit == other.device.unit
        is_alike = other.resembles(self.asked)
        if self.answers_from is None or other.answers_from is None:
            return is_same_unit or is_alike
        return is_same_unit and is_alike

    def may_get(self, pdu: bytes) -> bool:
        """Tell whether another client's request may get this response.

        Usually only its function counts: an exception fits any quantity, and another client may repeat its request with
        another one. But where the response repeats the request (05, 06), it fits no other.
        """
        asked = self.asked
        if pdu[0] != asked.function:
            return pdu[0] == asked.function | EXCEPTION_BIT
        return self.is_any or asked.data != asked.response_head or pdu == asked.data

    def gets(self, pdu: bytes) -> bool:
        """Tell whether a PDU answers this request of another client, or one of those that it stands for."""
        if self.is_any:
            return self.may_get(pdu) and response_size(pdu) in (0, len(pdu))
        return self.asked.accepts(pdu)

    def __repr__(self) -> str:
        return f"<Exchange unit={self.unit} {self.asked.data.hex(' ').upper()} owed={self.owed}>"


def foreign_request(frame: Frame, asked: RequestPdu, at: float, end: int) -> Exchange:
    """Make the exchange of another client's request, read at the time `at` and ending at the place `end`."""
    exchange = Exchange(frame.unit, frame.unit, asked, end)
    exchange.asked_at = at
    exchange.ends_at = at + FOREIGN_LASTS
    return exchange
