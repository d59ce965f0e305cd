"""A unit made in Python under random requests, beside a reference that knows only the rules of docs/images.md.

Clients ask whenever they like, and some leave. Calls are short or long, end late or not when they are cancelled, fail,
or return nonsense. Each request gets exactly the answer that the reference expects, at the same time; never the values
of another one, and no call begins for what got 06.
"""

import asyncio
from dataclasses import dataclass
from typing import Literal

from hypothesis import event, example, given
from hypothesis import strategies as st

from gateway.errors import IllegalAddress
from gateway.images.custom_unit import CustomUnit
from gateway.images.drivers.custom_driver import CustomDriver
from gateway.images.image import ImageSettings
from gateway.modbus.codes import Area
from gateway.request import Request
from gateway.trace.ring import Ring
from images.asking import GENERIC
from kit.asker import Asker
from kit.virtual_time import VirtualTimeLoop

TIMEOUT = 1.0
#: Tells times apart that would be equal.
TICK = 1e-5
NEVER = 1e9

Kind = Literal["values", "refusal", "error", "nonsense"]


@dataclass(frozen=True)
class Asked:
    """A request `after` the one before, for which the call takes `takes`, or `late` more if it is cancelled."""

    after: float
    client: int
    takes: float
    late: float
    kind: Kind


asked = st.builds(
    Asked,
    after=st.sampled_from([0.0, 0.0, 0.1, 0.4, 1.1, 3.0]),
    client=st.integers(0, 2),
    takes=st.sampled_from([0.0, 0.05, 0.3, 0.9, 1.2, 5.0]),
    late=st.sampled_from([0.0, 0.0, 0.5, 2.5, 6.0]),
    kind=st.sampled_from(["values", "values", "values", "refusal", "error", "nonsense"]),
)
lefts = st.dictionaries(st.integers(0, 2), st.sampled_from([0.55, 1.35, 4.05]), max_size=2)


class Scripted(CustomUnit):
    """Does for each address, which is the number of the request, what the script says."""

    def __init__(self, script: list[Asked]) -> None:
        self.script = script
        self.begun: list[int] = []
        self.at_once = 0

    async def read(self, area, address, count):
        one = self.script[address]
        self.begun.append(address)
        self.at_once += 1
        assert self.at_once == 1
        try:
            await asyncio.sleep(one.takes)
        except asyncio.CancelledError:
            await asyncio.sleep(one.late)
            raise
        finally:
            self.at_once -= 1
        if one.kind == "refusal":
            raise IllegalAddress
        if one.kind == "error":
            raise KeyError(address)
        return [address] * (count + 1 if one.kind == "nonsense" else count)


ANSWERS = {"refusal": "83 02", "error": "83 04", "nonsense": "83 04"}


class Reference:
    """One request after the other: when each is answered, and with what. It has no queue, no timers and no calls."""

    def __init__(self) -> None:
        self.free_at = 0.0
        self.hangs_from = NEVER
        self.failures = 0
        self.rest = 0.0
        self.rests_until = 0.0

    def answer(self, number: int, one: Asked, came: float, left: float) -> tuple[float, str]:
        """The time of the answer, and the answer, to the next request."""
        expires, begins = came + TIMEOUT, max(came, self.free_at)
        if begins >= expires:
            if came > self.hangs_from:  # it has waited for a call that does not end, and for nothing else
                self.fail(expires)
            return expires, "83 06"
        self.hangs_from = NEVER
        if left <= begins:
            return begins, "83 06"
        if begins < self.rests_until:
            return begins, "83 0B"
        if one.takes < TIMEOUT:
            self.free_at = begins + one.takes
            self.failures, self.rest, self.rests_until = 0, 0.0, 0.0
            values = f"03 02 {number.to_bytes(2, 'big').hex(' ').upper()}"
            return self.free_at, ANSWERS.get(one.kind, values)
        self.free_at = begins + TIMEOUT + one.late
        self.hangs_from = begins + TIMEOUT if one.late else NEVER
        self.fail(begins + TIMEOUT)
        return begins + TIMEOUT, "83 0B"

    def fail(self, now: float) -> None:
        """Count a failure, unless it rests."""
        if now < self.rests_until:
            return
        self.failures += 1
        if self.failures >= 3:
            self.rest = min(max(9 * TIMEOUT, 2 * self.rest), 60.0)
            self.rests_until = now + self.rest


class Timed(Asker):
    """Notes when each of its answers came."""

    def __init__(self, number: int) -> None:
        super().__init__(f"10.0.0.{number}:1")
        self.got: dict[Request, tuple[float, str | None]] = {}

    def answer(self, request, pdu):
        super().answer(request, pdu)
        assert request not in self.got, "answered twice"
        self.got[request] = (asyncio.get_running_loop().time(), self.answers[-1])


def same(got: tuple[float, str | None], expected: tuple[float, str]) -> bool:
    return got[1] == expected[1] and abs(got[0] - expected[0]) < TICK / 2


@given(st.lists(asked, min_size=1, max_size=12), lefts)
@example([Asked(0.0, 0, 5.0, 0.0, "values")] * 3 + [Asked(3.0, 0, 0.0, 0.0, "values")], {})
@example([Asked(0.0, 0, 5.0, 6.0, "values"), *[Asked(1.1, 1, 0.0, 0.0, "values")] * 8], {})
@example([Asked(0.0, 0, 0.9, 0.0, "values"), Asked(0.1, 1, 0.0, 0.0, "values")], {1: 0.55})
def test_each_request_gets_its_own_answer_in_time_and_in_turn(script, lefts):
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        came, clients, requests, begun = runner.run(played(script, lefts))
    reference = Reference()
    expected = [
        reference.answer(number, one, came[number], lefts.get(one.client, NEVER)) for number, one in enumerate(script)
    ]
    got = [clients[one.client].got.get(requests[number], (0.0, "none")) for number, one in enumerate(script)]
    event(" ".join(sorted({answer[:5] for _, answer in expected})))
    assert all(map(same, got, expected)), list(zip(got, expected, strict=True))
    assert not {number for number, (_, answer) in enumerate(got) if answer == "83 06"} & {*begun}
    assert begun == sorted(begun)
    for client in clients:
        done = [request for request, (_, answer) in client.got.items() if answer != "83 06"]
        assert done == sorted(done, key=requests.index)


async def played(script, lefts):
    """Ask all; when each request came, the clients, the requests, and the calls that have begun."""
    loop, unit = asyncio.get_running_loop(), Scripted(script)
    settings = ImageSettings(60, "unit", GENERIC, {Area.HOLDING: ((0, 99),)}, python="Scripted", timeout=TIMEOUT)
    driver = CustomDriver(settings, unit, loop, lambda _: None, Ring())
    clients = [Timed(number) for number in range(3)]
    for client, left in lefts.items():
        loop.call_at(left, setattr, clients[client], "gone", True)
    came, requests = [], []
    for number, one in enumerate(script):
        await asyncio.sleep(one.after + TICK)
        came.append(loop.time())
        requests.append(clients[one.client].ask(f"03 {number:04X} 0001", unit=60, now=loop.time()))
        driver.image.submit(requests[-1], loop.time())
    await asyncio.sleep(100.0)
    assert not driver.is_busy
    return came, clients, requests, unit.begun
