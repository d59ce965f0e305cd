"""A line on which anything may happen, by chance: for `differential`, which needs no rule for what is right.

Requests of ours and of another client, alone and many in a row; answers to them, late, damaged, twice, cut and of
others; echoes, lost ports, new connections, reloads. Time passes by chance, or until the line wants to be woken.
"""

import random
from collections.abc import Callable, Sequence
from typing import Any, Final

from kit.asker import Asker
from kit.line_bench import ASCII, LIMIT, TIMING, Bench
from kit.noise import flipped

#: What a line hands on to the next one on its port, and how that takes it: in whichever version, by one of these names.
HANDS_ON: Final = ("handed_on", "overdue")
TAKES_OVER: Final = ("take_over", "await_overdue")
#: So much happens on one line.
_LENGTH: Final = 60
#: For so many seconds after its request another client's answer may come, for a line that follows.
_PATIENCE: Final = 1.0
_MOST_AT_ONCE: Final = 30
_LONG: Final = 400.0
_PAUSES: Final = (0.0, 0.1, LIMIT, 2 * LIMIT, 3 * LIMIT, 1.5, 30.0)
#: A frame takes about so long, and a silence.
_SOON: Final = 0.02
#: Some are answered by what repeats them, some answers look like requests.
_REQUESTS: Final = (
    *("03 00 10 00 01", "03 00 20 00 01", "03 00 10 00 02", "04 00 10 00 01", "01 03 10 00 18", "02 00 00 00 18"),
    *("05 00 30 FF 00", "06 00 30 00 05", "06 00 30 00 06", "10 00 10 00 01 02 00 05", "08 00 0B 00 00", "41 01 02"),
    "08 00 04 00 00",
)


def method(line: object, names: Sequence[str]) -> Any:
    """Find the first of these methods that there is, of a line or of its ledger."""
    of = getattr(line, "ledger", line)
    return next(getattr(of, name) for name in names if hasattr(of, name))


class _Line:
    """What happens to one line."""

    def __init__(self, dice: random.Random) -> None:
        self._dice = dice
        self._settings = {
            "timing": dice.choice((TIMING, TIMING, ASCII)),
            "echo": dice.random() < 0.2,
            "retries": dice.choice((0, 0, 1, 2)),
            "late_window": dice.choice((None, None, 0.3)),
        }
        self._port = {"virtual": dice.random() < 0.5, "connection": dice.random() < 0.3}
        self._clients = [Asker(f"client-{number}", host=f"10.0.0.{number}") for number in range(3)]
        #: What was asked last, by anybody.
        self._asked: list[tuple[int, bytes]] = [(1, bytes.fromhex(_REQUESTS[0]))]
        self.bench = self._open()

    def _open(self) -> Bench:
        bench = Bench(**self._settings, **self._port)
        for unit, timeout in ((1, 0.2), (2, 0.2), (3, 0.8)):
            bench.device(unit, timeout=timeout, urgent=unit == 2)
        return bench

    def step(self) -> None:
        """Something happens."""
        kinds: dict[Callable[[], None], int] = {
            self.ask: 25, self.answer: 30, self.damage: 4, self.hear_other_client: 12, self.hear_many: 2,
            self.echo: 6, self.wait: 30, self.wait_exactly: 6, self.broadcast: 1, self.leave: 1, self.lose_port: 1,
            self.reload: 1, self.hold_back: 1,
        }  # fmt: skip
        (kind,) = self._dice.choices(list(kinds), list(kinds.values()))
        kind()
        if self.bench.line.must_renew(self.bench.now):
            self.bench.line.renew(self.bench.now)
            self.bench.plug()

    def ask(self) -> None:
        pdu, unit = self._dice.choice(_REQUESTS), self._dice.choice((1, 1, 2, 3))
        self._asked = [*self._asked[-5:], (unit, bytes.fromhex(pdu))]
        self.bench.ask(pdu, unit, self._dice.choice(self._clients))

    def broadcast(self) -> None:
        self.bench.broadcast(self._dice.choice(_REQUESTS), self._clients[0])

    def answer(self) -> None:
        data = bytes.fromhex(self.bench.frame(*self._response()))
        cut = self._dice.randrange(len(data)) if self._dice.random() < 0.1 else 0
        for piece in (data[:cut], data[cut:]):
            self.bench.hear(piece.hex())
        if self._dice.random() < 0.1:
            self.bench.hear(data.hex())

    def damage(self) -> None:
        data = bytes.fromhex(self.bench.frame(*self._response()))
        if self._dice.random() < 0.3:
            self.bench.line.received(data, self.bench.now, damaged=True)
        else:
            self.bench.hear(flipped(data, self._dice.randrange(8 * len(data))).hex())

    def _response(self) -> tuple[int, str]:
        unit, pdu = self._dice.choice(self._asked)
        if self.bench.written and self._dice.random() < 0.7:
            unit, pdu = self._decoded(bytes.fromhex(self.bench.written[-1]))
        if self._dice.random() < 0.15:
            return unit, bytes((pdu[0] | 0x80, 2)).hex()
        if pdu[0] > 4:
            return unit, pdu[:5].hex()
        size = 2 * pdu[4] if pdu[0] > 2 else (pdu[4] + 7) // 8
        return unit, (bytes((pdu[0], size)) + self._dice.randbytes(size)).hex()

    def _decoded(self, frame: bytes) -> tuple[int, bytes]:
        body = bytes.fromhex(frame[1:-4].decode()) if self._settings["timing"] is ASCII else frame[:-2]
        return body[0], body[1:]

    def hear_other_client(self, unit: int = 0) -> None:
        unit, pdu = unit or self._dice.choice((1, 1, 2, 9)), self._dice.choice(_REQUESTS)
        self._asked = [*self._asked[-5:], (unit, bytes.fromhex(pdu))]
        self.bench.respond(pdu, unit)

    def hear_many(self) -> None:
        unit = self._dice.choice((0, 1, 2))
        for _ in range(self._dice.randint(2, _MOST_AT_ONCE)):
            self.hear_other_client(unit)
            self.bench.pass_time(0.005)

    def echo(self) -> None:
        """What was written last comes back, about when it has left."""
        self.bench.pass_time(self._dice.choice((0.0, self._dice.uniform(0.0, _SOON / 2))))
        if self.bench.written:
            self.bench.hear(self.bench.written[-1])

    def wait(self) -> None:
        is_long = self._dice.random() < 0.3
        self.bench.pass_time(self._dice.choice(_PAUSES) if is_long else self._dice.uniform(0.0, _SOON))

    def wait_exactly(self) -> None:
        self.bench.pass_time(max(0.0, (self.bench.line.deadline() or 0.0) - self.bench.now))

    def hold_back(self) -> None:
        self.bench.arrives = not self.bench.arrives

    def leave(self) -> None:
        at = self._dice.randrange(len(self._clients))
        self._clients[at].gone = True
        self._clients[at] = Asker(self._clients[at].caller.client, host=self._clients[at].caller.host)

    def lose_port(self) -> None:
        self.bench.unplug()
        self.wait()
        self.bench.plug()

    def reload(self) -> None:
        before, now = self.bench.line, self.bench.now
        before.finish(now)
        self.bench.pass_time(_PATIENCE)
        handed_on = method(before, HANDS_ON)(self.bench.now, _PATIENCE)
        after = self._open()
        after.now, self.bench = self.bench.now, after
        after.plug()
        method(after.line, TAKES_OVER)(handed_on, _PATIENCE)

    def end(self) -> str:
        """Let all end; what was counted."""
        self.bench.pass_time(_LONG)
        return f"counts {self.bench.counts}, {len(self.bench.events)} events"


def play(count: int, seed: int, note: Callable[[str], None], follow: Callable[[Callable[[], float]], None]) -> None:
    """Play so many lines. What happens is told to `note`, what has the time is told to `follow`."""
    dice = random.Random(seed)
    for _ in range(count):
        follow(lambda: 0.0)
        line = _Line(dice)
        follow(lambda line=line: line.bench.now)
        for _ in range(_LENGTH):
            line.step()
        note(line.end())
