"""Plays conversations on one line, in virtual time: see `conversation` for how they are written.

    # a late answer is nobody's
    line: mode = rtu or ascii, late_window = 1 s
    unit 2: timeout = 2 s
    client >> 01 03 00 10 00 01
    line   >> [01 03 00 10 00 01]
    client << 01 83 0B
    line   << 55 half [01 03 02 01 10]
    wait 20 ms
    line   << rest [01 03 02 01 10]
    event LateResponse unit 1, function 3
    counts unit 1: late_responses 1

`[..]` is the frame of this unit and PDU, in the line's mode with its check; before it, `half` and `rest` cut it in two,
and `wrong` spoils its check. Bytes outside of brackets are as they are. Each `line <<` is one read. What no step has
shown when a conversation ends, a frame or an answer, fails it.

| step                             | meaning                                                                      |
|----------------------------------|------------------------------------------------------------------------------|
| `panel >> 01 03 00 10 00 01`     | a client of any name asks; each has an address of its own                    |
| `panel then 01 03 00 10 00 01`   | it asks this as soon as it gets its next answer, out of that                 |
| `panel << 01 83 0B at once`      | it gets this without any time passing. `line >> .. at once`: the same        |
| `panel << nothing`               | its request is over without an answer: a broadcast                           |
| `panel silent`, `panel leaves`   | it has got nothing else; it disconnects                                      |
| `scan >> 09 03 00 00 00 01`      | a scan asks in the line's idle time; `scan <<` is what it gets in time       |
| `scan hears 09 03 02 00 07`      | the scan is told of this answer, in time or late                             |
| `scan failed timeout`            | why the first question failed                                                |
| `line << damaged 01 03`          | a character of these bytes had a parity or framing error                     |
| `line silent`                    | nothing else was put on the line                                             |
| `line woken x 40`                | it is woken so often, though it does not want to be                          |
| `line read in 4.6 ms`            | its port need not be read before then; `at once`: the next byte may decide   |
| `line babbles 200 ms`            | a byte 55 comes in each millisecond                                          |
| `line empty`                     | nothing is left behind in it: no request, no exchange                        |
| `line finishes`                  | the gateway ends: the line takes no more requests                            |
| `wait 20 ms`                     | time passes, and the line is woken when it wants to be                       |
| `busy 20 ms`                     | time passes, and nobody wakes the line: the machine is busy                  |
| `port lost`, `port back`         | the port is lost, or open (again)                                            |
| `port ends`, `port ends early`   | the server closes its connection in order; early: as soon as it was opened   |
| `port wanted`, `port not wanted` | the line has it opened again since then, or not                              |
| `port renewed`, `port kept`      | the line closes its connection itself, for a new one, or needs not to        |
| `port left`                      | the line has closed it, because nobody had asked for so long                 |
| `port stuck`, `port flows`       | what is written has not arrived at the other end of the connection; it has   |
| `port lent`, `port returned`     | meanwhile another line has the port, and what is open is handed to and fro   |
| `lease lost`, `lease held`       | on a `shared` line: nothing is sent without the lease                        |
| `reload`, `restart`              | another line takes over the port and what is open, from memory or by file    |
| `3 x (line << 55; wait 1 ms)`    | these steps, so often                                                        |

Steps for what the operator sees stand in `operator_view`, settings in `stage_settings`, and all that may stand for
frames in `frames_in_text`.

A time limit is `timeout`, the answer on the wire, and 5 ms: 209.0 ms after the request for a read of one register,
which takes 4.6 ms (8 characters); its late window is twice as long. In ASCII 220.6 ms and 17.7 ms.
"""

import re
from collections.abc import Callable
from functools import partial

from gateway.devices.device import ScannedUnit
from gateway.lines.transaction import ScanTransaction
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import parse_request
from gateway.request import Request
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from kit.asker import Asker
from kit.conversation import Conversation, seconds
from kit.frames_in_text import read_bytes
from kit.line_bench import Bench, is_empty
from kit.operator_view import OperatorView, assert_same
from kit.stage_settings import StageSettings

#: How long a step waits for what it shows, in seconds.
_PATIENCE = 120.0
_REPEATED = re.compile(r"(\d+) x \((.*)\)")


class NamedClient(Asker):
    """An Asker whose answers have their unit, and are `nothing` where a request ended without one.

    One that has left gets no answer. `next` is asked out of its next answer.
    """

    next: Callable[[], None] | None = None

    def answer(self, request: Request, pdu: bytes | None) -> None:
        if self.next is not None:
            ask, self.next = self.next, None
            ask()
        if not self.gone:
            self.answers.append("nothing" if pdu is None else f"{request.unit:02X} {pdu.hex(' ').upper()}")


class LineStage:
    """One line, its clients, and what each step does to them."""

    def __init__(self, conversation: Conversation) -> None:
        self._conversation = conversation
        self._settings = StageSettings(conversation.settings)
        self._clients: dict[str, NamedClient] = {}
        self._heard: list[tuple[Frame, float]] = []
        self._questions: list[Request] = []
        self._scanned: dict[int, ScannedUnit] = {}
        self._opened = 0
        self._lender: Bench
        self._view = OperatorView()
        self._view.bench = self._bench = self._new_bench()

    def play(self) -> None:
        """Play all steps."""
        for step in self._conversation.steps:
            at = self._bench.now
            try:
                self._play(step)
            except Exception as error:
                error.add_note(f"in `{step}`, at {1000 * (at - 101.0):.2f} ms, of: {self._conversation.title}")
                raise
        self._nothing_is_left()

    def _play(self, step: str) -> None:
        if repeated := _REPEATED.fullmatch(step):
            for each in int(repeated[1]) * repeated[2].split("; "):
                self._play(each)
            return
        who, _, rest = step.partition(" ")
        rest = rest.strip()
        match who:
            case "wait":
                self._bench.pass_time(seconds(rest))
            case "busy":
                self._bench.now += seconds(rest)
            case "line":
                self._line(*split(rest))
            case "port":
                self._port(rest)
            case "lease":
                self._bench.has_lease = {"held": True, "lost": False}[rest]
            case "reload" | "restart":
                self._hand_over(by_file=who == "restart")
            case _:
                if not self._view.play(who, rest):
                    self._client(who, rest)

    def _client(self, name: str, rest: str) -> None:
        client = self._clients.setdefault(name, NamedClient(f"{name}:1", host=name))
        what, text = split(rest)
        match what:
            case ">>":
                self._ask(client, text)
            case "<<":
                self._await(text, lambda: client.answers)
                assert_same(client.answers.pop(0), text.removesuffix(" at once"))
            case "then":
                client.next = partial(self._ask, client, text)
            case "silent":
                assert client.answers == [], client.answers
            case "leaves":
                client.gone = True
            case "hears":
                frame, _ = self._heard.pop(0)
                assert f"{frame.unit:02X} {frame.pdu.hex(' ').upper()}" == text
            case "failed":
                assert next(each.error.result for each in self._questions if each.error is not None) == text
            case _:
                raise ValueError(rest)

    def _ask(self, client: NamedClient, text: str) -> None:
        unit, pdu = int(text[:2], 16), text[3:]
        if client.caller.client == "scan:1":
            self._scan(client, unit, pdu)
        elif unit == 0 and unit not in self._bench.devices:
            self._bench.broadcast(pdu, client)
        else:
            self._bench.ask(pdu, unit, client)

    def _scan(self, client: NamedClient, unit: int, pdu: str) -> None:
        settings = {"awaits_second": True, "patience": 0.0} | self._settings.of("scan")
        request = client.ask(pdu, unit=unit, now=self._bench.now)
        self._questions.append(request)
        if unit not in self._scanned:
            answer_time = AnswerTime(TimingTable(), margin=1.0, timeout=0.2)
            self._scanned[unit] = ScannedUnit(unit, answer_time, lambda: self._bench.now)
            self._scanned[unit].heard = self._heard
        question = ScanTransaction(request, parse_request(request.pdu), self._scanned[unit], **settings)
        self._bench.line.submit(question, self._bench.now)

    def _line(self, what: str, text: str) -> None:
        bench = self._bench
        match what:
            case ">>":
                self._await(text, lambda: bench.written)
                expected = read_bytes(text.removesuffix(" at once"), bench.frame)
                assert_same(bench.written.pop(0), expected.hex(" ").upper())
            case "<<":
                data = read_bytes(text.removeprefix("damaged "), bench.frame)
                bench.line.received(data, bench.now, damaged=text.startswith("damaged "))
            case "silent":
                assert bench.written == [], bench.written
            case "empty":
                bench.line.ledger.expire(bench.now)
                assert is_empty(bench.line)
                assert bench.line.ledger.late == []
            case "woken":
                for _ in range(int(text.removeprefix("x "))):
                    bench.line.tick(bench.now)
            case "read":
                at = bench.line.read_at(bench.now)
                assert_same("at once" if at is None else f"in {1000 * (at - bench.now):.1f} ms", text)
            case "babbles":
                self._babble(bench.now + seconds(text))
            case "finishes":
                bench.line.finish(bench.now)
            case _:
                self._view.line(what, text)

    def _babble(self, until: float) -> None:
        while self._bench.now < until:
            self._bench.hear("55")
            self._bench.pass_time(0.001)

    def _port(self, what: str) -> None:
        bench = self._bench
        match what:
            case "lost":
                bench.unplug()
            case "back":
                bench.plug()
            case "ends" | "ends early":
                self._opened = 0
                bench.line.port_ended(self._open_again, bench.now, at_once=what == "ends early")
            case "wanted" | "not wanted":
                assert self._opened == (what == "wanted")
            case "renewed" | "left":
                self._close_port(is_stuck=what == "renewed")
            case "kept":
                assert not bench.line.must_renew(bench.now)
                assert not bench.line.is_closed
            case "lent":
                self._lender = bench
                self._hand_over()
            case "returned":
                self._hand_over(self._lender)
            case "stuck" | "flows":
                bench.arrives = what == "flows"
            case _:
                raise ValueError(what)

    def _close_port(self, *, is_stuck: bool) -> None:
        line, now = self._bench.line, self._bench.now
        assert line.must_renew(now) == is_stuck
        if is_stuck:
            line.renew(now)
        assert line.is_closed
        self._opened = 0
        line.port_ended(self._open_again, now)

    def _open_again(self) -> None:
        self._opened += 1

    def _await(self, text: str, seen: Callable[[], object]) -> None:
        """Let time pass until something is seen."""
        bench = self._bench
        end = bench.now if text.endswith(" at once") else bench.now + _PATIENCE
        while not seen():
            deadline = bench.line.deadline()
            assert deadline is not None, "the line waits for nothing"
            assert deadline <= end, "it does not come"
            assert not bench.line.must_renew(bench.now), "the line waits for a new connection"
            bench.now = max(deadline, bench.now)
            bench.tick()

    def _hand_over(self, successor: Bench | None = None, *, by_file: bool = False) -> None:
        before = self._bench
        before.unplug()
        self._nothing_is_written(before)
        self._view.bench = self._bench = successor or self._new_bench()
        self._bench.take_over(before, by_file=by_file)
        self._bench.events[:0] = before.events

    def _nothing_is_left(self) -> None:
        """Check that the conversation has shown all frames and answers."""
        self._nothing_is_written(self._bench)
        assert {name: client.answers for name, client in self._clients.items() if client.answers} == {}
        assert self._heard == []

    def _nothing_is_written(self, bench: Bench) -> None:
        assert bench.written == [], "the conversation does not show that"

    def _new_bench(self) -> Bench:
        return self._settings.new_bench(self._view.ring)


def split(text: str) -> tuple[str, str]:
    """Split the first word from the rest."""
    first, _, rest = text.partition(" ")
    return first, rest
