"""A client for tests of the parts behind it: it asks, and remembers what it was answered."""

from gateway.request import Caller, Origin, Request


class Asker(Origin):
    """An Origin. `answers` holds the response PDUs in hex, in the order they came; None for a broadcast that ended."""

    def __init__(self, client: str = "10.0.0.9:49152", *, host: str = "127.0.0.1", share_key: str = "") -> None:
        """`share_key` is `host` unless it is given."""
        self.caller = Caller(client, host, share_key or host)
        self.answers: list[str | None] = []
        self._asked: list[Request] = []
        self._gone = False

    @property
    def gone(self) -> bool:
        """Whether it has left. When it leaves, it gives up what it has asked."""
        return self._gone

    @gone.setter
    def gone(self, gone: bool) -> None:
        self._gone = gone
        for request in self._asked:
            request.give_up()

    def ask(self, pdu: str, *, unit: int = 1, now: float = 0.0) -> Request:
        self._asked.append(Request(unit, bytes.fromhex(pdu), self, now))
        return self._asked[-1]

    def wants(self, request: Request) -> bool:
        return not self.gone

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.answers.append(pdu.hex(" ").upper() if pdu is not None else None)
