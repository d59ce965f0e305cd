"""All that is heard on a line from a request on: kept until its answer is there, to tell what else was on the line."""

from typing import Final

from gateway.lines.overheard import Overheard, has_begun, overheard
from gateway.lines.transaction import Transaction
from gateway.modbus.chartime import Mode
from gateway.modbus.frame import Frame, ResponseFramer

#: So much is kept of what was heard.
_SIZE: Final = 1024


class Hearing:
    """What was heard since one request was sent.

    `sent` is the request's frame. `early` came before all of it can have left, so that it can be no answer. `late` are
    answers to older requests, which have their own receiver. `foreign` says that other frames came that are no answer.
    """

    def __init__(self) -> None:
        self.sent = b""
        self.early = bytearray()
        self.late: list[Frame] = []
        self.foreign = False
        self._heard = bytearray()

    def begin(self) -> None:
        """A request goes on the line: forget what came before."""
        self.early.clear()
        self.late.clear()
        self.foreign = False
        self._heard.clear()

    def keep_early(self, data: bytes) -> None:
        """These bytes came before the request can have left."""
        if len(self.early) < _SIZE:
            self.early += data

    def keep(self, data: bytes) -> None:
        """These bytes came since."""
        if len(self._heard) < _SIZE:
            self._heard += data

    def before(self, answer: Frame, mode: Mode, framer: ResponseFramer) -> Overheard:
        """What was heard before `answer`."""
        return overheard(mode, bytes(self.early + self._heard), self.sent, framer.encode(*answer))

    def instead(self, framer: ResponseFramer) -> bytes:
        """What was heard instead of an answer: everything but late answers to older requests."""
        heard = bytes(self.early + self._heard)
        for frame in self.late:
            heard = heard.replace(framer.encode(*frame), b"")
        return heard

    def has_begun(self, transaction: Transaction, mode: Mode, framer: ResponseFramer) -> bool:
        """Whether the answer has begun to come."""
        head = transaction.asked.response_head
        expected = head if transaction.answers_from is None else bytes((transaction.answers_from,)) + head
        return has_begun(mode, self.instead(framer).replace(self.sent, b""), expected)
