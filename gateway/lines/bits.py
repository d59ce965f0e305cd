"""A write to some bits of a register, of a device without function 22: a read and a write in one turn (ADR 33).

    waits ──its turn──▶ read ──valid response──▶ write, before anything else ──▶ the response
                         ├──its repeat──▶ read
                         ├──exception, none, a doubtful one──▶ the same; nothing is written
                         └──a guard that the write would break──▶ 03; nothing is written

Each of these is a transaction of its own, so line and upstream treat it as any other. What differs: nothing of the
gateway comes between read and write, so the register is written as it was read but for these bits; and on a line with
another client, which could come between, neither is sent.
"""

from gateway.errors import RequestError
from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.codes import EXCEPTION_BIT, FunctionCode
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.registers.masks import read_before, write_after
from gateway.request import Request


class BitsTransaction(Transaction):
    """A request of function 22 that waits for its turn."""

    __slots__ = ()

    is_of_bits = True

    def opening(self) -> Transaction:
        """Make the read, which is sent in its place."""
        request = self.requests[0]
        return BitsRead(request, parse_request(read_before(request.pdu)), self.device)

    def resembles(self, earlier: RequestPdu) -> bool:
        """Tell whether a late response to `earlier` could be taken for that to its read, or it may still write."""
        return earlier.function == FunctionCode.READ_HOLDING_REGISTERS or not earlier.only_reads


class BitsRead(BitsTransaction):
    """The read of the register. Its response ends the request only if it is an exception, or forbids the write."""

    __slots__ = ("_refusal",)

    def __init__(self, request: Request, asked: RequestPdu, device: Destination) -> None:
        super().__init__(request, asked, device)
        self._refusal: RequestError | None = None

    def opening(self) -> Transaction:
        """Return itself."""
        return self

    def following(self, pdu: bytes) -> Transaction | None:
        """Make the write that follows from the response; None after an exception, or if it must not be sent."""
        if pdu[0] & EXCEPTION_BIT:
            return None
        request = self.requests[0]
        written = write_after(request.pdu, int.from_bytes(pdu[2:], "big"), request.in_one_turn)
        try:
            return BitsWrite(request, self.device.check(written), self.device)
        except RequestError as error:
            self._refusal = error
            return None

    def respond(self, pdu: bytes, now: float) -> None:
        """Pass an exception on, or say why nothing is written; else only measure the response."""
        if pdu[0] & EXCEPTION_BIT:
            super().respond(_exception(pdu), now)
            return
        self.times.samples.add(self.asked.items, now - self.ends_at)
        if self._refusal is not None:
            self.device.refuse(self.requests[0], self._refusal, now)


class BitsWrite(BitsTransaction):
    """The write of the register, which was read just before. It is sent next or not at all, and never again."""

    __slots__ = ()

    def opening(self) -> Transaction:
        """Return itself."""
        return self

    @property
    def is_repeat(self) -> bool:
        """True: its request is under way since the read was sent."""
        return True

    def respond(self, pdu: bytes, now: float) -> None:
        """Answer the request: the response repeats it, or has the exception of the write."""
        super().respond(_exception(pdu) if pdu[0] & EXCEPTION_BIT else self.requests[0].pdu, now)


def _exception(pdu: bytes) -> bytes:
    """Make an exception of the read or the write one of function 22."""
    return bytes((FunctionCode.MASK_WRITE_REGISTER | EXCEPTION_BIT, pdu[1]))
