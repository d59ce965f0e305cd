"""Somebody who has asked one thing on a line and takes the answers to it that a scanner finds."""

from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu
from gateway.modbus.scan import Expected, Scanner, Token
from gateway.modbus.scan_ascii import AsciiScanner
from gateway.modbus.scan_rtu import RtuScanner

SILENCE = 0.002


class Asked:
    """Asks `asked` of `unit`, None for whatever unit."""

    def __init__(self, unit: int | None, asked: RequestPdu, mode: str = "rtu", *, sent: bytes = b"") -> None:
        self.scanner: Scanner = AsciiScanner() if mode == "ascii" else RtuScanner(SILENCE)
        self.others: list[Frame] = []
        self._unexplained_from = 0
        self._noise = 0
        self._sent = sent
        self.expect(unit, asked)

    def expect(self, unit: int | None, asked: RequestPdu) -> None:
        """Ask something else."""
        self._others(self.scanner.end())
        self.others.clear()
        self._noise, self._explained = 0, self.scanner.position
        self.expected = Expected(unit, asked, self.scanner.position)
        self.scanner.expect(
            self.expected, self._sent or self.scanner.encode(unit or 1, asked.data), echoes=bool(self._sent)
        )

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """The answers that are complete with these bytes."""
        return self._answers(self.scanner.received(data, now, damaged=damaged))

    def tick(self, now: float) -> list[Frame]:
        """The answers that silence has ended."""
        return self._answers(self.scanner.tick(now))

    def deadline(self) -> float | None:
        """When silence shows more."""
        return self.scanner.deadline(self.expected)

    @property
    def missing(self) -> int:
        """What must come before there is an answer."""
        return self.scanner.missing

    def conclude(self) -> list[Frame]:
        """Nothing is awaited any more: all frames that were not the answer."""
        self._others(self.scanner.end())
        return self.others

    @property
    def heard_noise(self) -> bool:
        """Whether there is anything but frames."""
        return self._noise > 0 or self._explained < self.scanner.position

    def _answers(self, tokens: list[Token]) -> list[Frame]:
        expected, answers = self.expected, []
        for token in tokens:
            fits = token.start >= expected.since and expected.answers_from in (None, token.frame.unit)
            if fits and not token.is_damaged and expected.asked.accepts(token.frame.pdu):
                answers.append(token.frame)
                self._explain(token)
            else:
                self._others([token])
        return answers

    def _others(self, tokens: list[Token]) -> None:
        for token in tokens:
            self.others += [] if token.is_damaged else [token.frame]
            self._explain(token)

    def _explain(self, token: Token) -> None:
        if token.start >= self._explained and not token.is_damaged:
            self._noise += token.start - self._explained
            self._explained = token.end
