"""A client for tests of the parts behind it: it asks, and remembers what it was answered."""

from gateway.request import Request


class Asker:
    """An Origin. `answers` holds the response PDUs in hex, in the order they came; None for a broadcast that ended."""

    def __init__(
        self, client: str = "10.0.0.9:49152", *, host: str = "127.0.0.1", address: str = "", row: str = ""
    ) -> None:
        """`address` is `host` unless it is given, and `row` is `client`."""
        self.client = client
        self.host = host
        self.address = address or host
        self.row = row or client
        self.gone = False
        self.answers: list[str | None] = []

    def ask(self, pdu: str, *, unit: int = 1, now: float = 0.0) -> Request:
        return Request(unit, bytes.fromhex(pdu), self, now)

    def wants(self, request: Request) -> bool:
        return not self.gone

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.answers.append(pdu.hex(" ").upper() if pdu is not None else None)
