"""Whatever clients ask and a line says, in any order: every request has exactly one answer, and never a wrong one.

Values tell which unit, function and register they are of. What nobody could detect is left out: a response after its
late window, and a copy of one inside the next transaction of the same shape.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.lines.counts import RESULTS
from gateway.modbus.rtu import crc_fits
from gateway.request import Caller, Origin, Request
from kit.line_bench import ASCII, LIMIT, TIMING, Bench

CLIENTS = 3
UNITS = (1, 2, 3)
#: Two equal windows after a limit, less what a write's longer frame adds.
LATEST = 2.9 * LIMIT


@dataclass(eq=False)
class Owed:
    """An answer that a device may still give, and until when it does."""

    frame: str
    until: float


class Client(Origin):
    """An Origin that checks each answer against its request."""

    def __init__(self, name: str) -> None:
        self.caller = Caller(name, "127.0.0.1", "127.0.0.1")
        self.gone = False
        self.answers: dict[Request, str | None] = {}

    def wants(self, request: Request) -> bool:
        return not self.gone

    def answer(self, request: Request, pdu: bytes | None) -> None:
        assert request not in self.answers, "answered twice"
        self.answers[request] = None if pdu is None else pdu.hex(" ").upper()
        if pdu is None:
            assert self.gone or request.unit == 0
        elif pdu[0] < 0x80:
            assert self.answers[request] == right_answer(request.unit, request.pdu), request


class Traffic(Bench):
    """A bench whose devices remember what they owe, and which sees to the order of what goes on the line."""

    def __init__(self, **settings: object) -> None:
        self.owed: list[Owed] = []
        self.rest = ""
        self.echo = ""
        self.serials: dict[Request, int] = {}
        self.sent: set[Request] = set()
        self.passed: set[Request] = set()
        super().__init__(**settings)
        self.clients = [Client(f"10.0.0.{number}:1") for number in range(CLIENTS)]

    def submits(self, client: int, unit: int, kind: int, register: int) -> None:
        origin = self.clients[client]
        serial = len(self.serials)
        if unit == 0:
            pdu = bytes((6, 0, 1)) + serial.to_bytes(2)
        else:
            pdu = bytes((kind, unit, register)) + (serial if kind == 6 else 1).to_bytes(2)
        if origin.gone:
            return
        request = Request(unit, pdu, origin, self.now)
        self.serials[request] = serial
        target = self.everyone if unit == 0 else self.devices.get(unit) or self.device(unit)
        target.submit(request, self.now)

    def answers_come(self, which: int, *, broken: bool, half: bool, twice: bool) -> None:
        """One of the answers that are owed comes, if there is still time."""
        self.owed = [owed for owed in self.owed if owed.until > self.now]
        if not self.owed:
            return
        frame = self.owed.pop(which % len(self.owed)).frame
        if broken:
            damaged = bytearray.fromhex(frame)
            damaged[len(damaged) // 2] ^= 1
            frame = damaged.hex()
        if half:
            self.says(frame[:6])
            self.rest = frame[6:]
        else:
            self.says(frame + frame if twice else frame)

    def says(self, data: str) -> None:
        """The line says this; the rest of what has begun, and the echo of what was sent, come first."""
        data, self.rest, self.echo = self.echo + self.rest + data, "", ""
        if data:
            self.hear(data)

    def passes(self, seconds: float) -> None:
        self.says("")
        self.pass_time(seconds)

    def replugs(self) -> None:
        self.unplug()
        self.echo = ""
        for owed in self.owed:
            owed.until = min(owed.until, self.now + 1.9 * LIMIT)
        self.pass_time(0.05)
        self.plug()

    def ends(self) -> None:
        """Let all of it come to its end."""
        self.passes(300.0)
        for request in self.serials:
            assert request in request.origin.answers, f"{request} has no answer"
        counts = self.counts
        assert sum(getattr(counts, result) for result in RESULTS) == len(self.serials), "each request has one result"
        assert (self.line.ledger.count_late(self.now), len(self.line.queue)) == (0, 0)
        assert not self.line.is_busy
        assert self.line.deadline() is None

    def _write(self, data: bytes) -> None:
        super()._write(data)
        if self.settings.echo:
            self.echo += data.hex()
        unit, pdu = self._decoded(data)
        units = UNITS if unit == 0 else (unit,)
        waiting = [self._waiting(client, units) for client in self.clients]
        fitting = [[each for each in requests if (each.unit, each.pdu) == (unit, pdu)] for requests in waiting]
        firsts = {fits[0] for fits, requests in zip(fitting, waiting, strict=True) if fits and fits[0] is requests[0]}
        still_open = [each for each in self.sent if each not in each.origin.answers]
        is_repeat = any((each.unit, each.pdu) == (unit, pdu) for each in still_open)
        if not firsts and not is_repeat:
            late = [(fits[0], requests) for fits, requests in zip(fitting, waiting, strict=True) if fits]
            assert late, "out of order"
            if len(late) == 1:  # else nobody can tell whose it is
                ((first, requests),) = late
                self.passed.update(requests[: requests.index(first)])  # these are about to fail: they are never sent
            firsts = {first for first, _ in late}
        self.sent |= firsts
        if unit:
            self.owed.append(Owed(self.frame(unit, right_answer(unit, pdu)), self.now + LATEST))

    def _decoded(self, data: bytes) -> tuple[int, bytes]:
        body = bytes.fromhex(data[1:-4].decode()) if self.settings.timing.mode == "ascii" else data[:-2]
        return body[0], body[1:]

    def _waiting(self, client: Client, units: Collection[int]) -> list[Request]:
        """The requests of a client to these units that may still be sent, the oldest first; a broadcast is for all."""
        over = {*client.answers, *self.sent, *self.passed}
        return [
            each for each in self.serials if each.origin is client and each.unit in (0, *units) and each not in over
        ]


def right_answer(unit: int, pdu: bytes) -> str:
    """What the unit answers: its number, the function and the register are in the value."""
    if pdu[0] == 6:
        return pdu.hex(" ").upper()
    return bytes((pdu[0], 2, unit << 4 | pdu[0], pdu[2])).hex(" ").upper()


SELDOM = st.sampled_from([False, False, True])
SUBMIT = st.builds(
    partial,
    st.just(Traffic.submits),
    client=st.integers(0, CLIENTS - 1),
    unit=st.sampled_from([*UNITS, *UNITS, 0]),
    kind=st.sampled_from([3, 3, 4, 6]),
    register=st.integers(0, 2),
)
ANSWER = st.builds(
    partial, st.just(Traffic.answers_come), which=st.integers(0, 3), broken=SELDOM, half=SELDOM, twice=SELDOM
)
PASS = st.builds(partial, st.just(Traffic.passes), seconds=st.sampled_from([0.001, 0.003, 0.05, 0.21, 0.5, 2.0]))
NOISE = st.builds(partial, st.just(Traffic.says), data=st.binary(min_size=1, max_size=12).map(bytes.hex))
REPLUG = st.builds(partial, st.just(Traffic.replugs))
ACTIONS = st.one_of(SUBMIT, SUBMIT, SUBMIT, ANSWER, ANSWER, PASS, PASS, NOISE, REPLUG)

LINES = st.fixed_dictionaries(
    {
        "timing": st.sampled_from([TIMING, ASCII]),
        "gap": st.sampled_from([None, 0.0, 0.1]),
        "retries": st.integers(0, 2),
        "queue": st.sampled_from([2, 64]),
        "max_wait": st.sampled_from([0.3, 2.0]),
        "echo": st.booleans(),
        "coalesce": st.booleans(),
    }
)


@pytest.mark.search
@pytest.mark.timeout(300)
@settings(max_examples=300, deadline=None)
@given(line=LINES, actions=st.lists(ACTIONS, max_size=60), leaves=st.integers(0, 120))
def test_every_request_has_one_answer_and_never_a_wrong_one(line, actions, leaves):
    traffic = Traffic(**line)
    for number, action in enumerate(actions):
        traffic.clients[0].gone = number >= leaves
        action(traffic)
    traffic.ends()


def test_the_values_are_as_telling_as_they_are_meant_to_be():
    answers = {right_answer(unit, bytes((kind, unit, register, 0, 1))) for unit in UNITS for kind in (3, 4)
               for register in range(3)}  # fmt: skip
    assert len(answers) == 18
    assert crc_fits(bytes.fromhex(Bench().frame(1, right_answer(1, bytes((3, 1, 0, 0, 1))))))
