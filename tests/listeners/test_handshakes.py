"""Which clients may begin a handshake while many are not done."""

import asyncio
import time
from typing import Any

from gateway.listeners.handshakes import (
    MADE_ROOM,
    MOST,
    SLOW,
    TOO_MANY,
    ConnectingClient,
    Handshakes,
)
from gateway.request import Caller


class Stream:
    """A TlsStream whose handshake is never done."""

    def __init__(self, owner: Handshakes) -> None:
        self._owner: Any = owner
        self.rejected = ""
        self.has_response = False
        self.has_stepped = asyncio.Event()
        #: For how many seconds the machine stands still during a step.
        self.stands_still = 0.0

    def start(self) -> None:
        pass

    def step(self) -> None:
        time.sleep(self.stands_still)

    def stepped(self, reason: None) -> None:
        self.has_stepped.set()

    def abort(self) -> None:
        pass

    def reject(self, reason: str) -> None:
        self.rejected = reason
        self._owner.not_secured(self, reason)


def begun(owner: Handshakes, *origins: str) -> list[Stream]:
    streams: list[Any] = []
    now = asyncio.get_running_loop().time()
    for origin in origins:
        assert owner.make_room(origin, now) == ""
        streams.append(Stream(owner))
        owner.begin(streams[-1], ConnectingClient(Caller(f"{origin}:1", origin, origin)), now)
    return streams


def handshakes() -> Handshakes:
    return Handshakes(lambda *_: None, lambda *_: None)


async def test_clients_of_one_address_that_say_nothing_make_room_for_another_one_of_it() -> None:
    owner = handshakes()
    begins = asyncio.get_running_loop().time()
    first, *others = begun(owner, *["10.0.0.1"] * MOST)
    assert owner.make_room("10.0.0.1", begins + SLOW - 0.01) == TOO_MANY
    assert owner.make_room("10.0.0.1", begins + SLOW) == ""
    assert first.rejected == MADE_ROOM
    assert not any(each.rejected for each in others)


async def test_the_address_with_most_of_them_makes_room() -> None:
    owner = handshakes()
    once, *_ = begun(owner, "10.0.1.1")
    twice, _ = begun(owner, "10.0.1.2", "10.0.1.2")
    begun(owner, *(f"10.0.0.{number}" for number in range(MOST - 3)))
    assert owner.make_room("10.0.2.1", 0.0) == ""
    assert (once.rejected, twice.rejected) == ("", MADE_ROOM)


async def test_if_each_address_has_one_the_slowest_client_makes_room() -> None:
    owner = handshakes()
    begins = asyncio.get_running_loop().time()
    active, silent, *others = begun(owner, *(f"10.0.0.{number}" for number in range(MOST)))
    owner._is_working = True  # a step of another one is under way
    owner.step_due(active)
    assert owner.make_room("10.0.2.1", begins + SLOW - 0.01) == TOO_MANY
    assert owner.make_room("10.0.2.1", begins + SLOW) == ""
    assert (active.rejected, silent.rejected) == ("", MADE_ROOM)
    assert not any(each.rejected for each in others)


async def test_an_address_with_many_of_them_ends_its_own_only() -> None:
    """However many it begins, and however slow others are."""
    owner = handshakes()
    slow = begun(owner, "10.0.0.1", "10.0.0.2")
    await asyncio.sleep(SLOW)
    many = begun(owner, *["10.0.1.1"] * (MOST - 2))
    assert owner.make_room("10.0.1.1", asyncio.get_running_loop().time()) == TOO_MANY
    await asyncio.sleep(SLOW)
    many += begun(owner, *["10.0.1.1"] * (MOST - 2))
    assert [each.rejected for each in slow + many] == ["", "", *[MADE_ROOM] * (MOST - 2), *[""] * (MOST - 2)]


async def test_a_client_that_sends_a_byte_now_and_then_is_slow() -> None:
    owner = handshakes()
    trickling = begun(owner, "10.0.0.1")[0]
    for _ in range(3):
        await asyncio.sleep(SLOW / 3)
        owner.step_due(trickling)
        await asyncio.sleep(0.001)
    begun(owner, *(f"10.0.1.{number}" for number in range(MOST - 1)))
    assert owner.make_room("10.0.2.1", asyncio.get_running_loop().time()) == ""
    assert trickling.rejected == MADE_ROOM
    owner.close()


async def test_a_client_that_goes_on_is_not_slow() -> None:
    """However many others come: else each would end the handshake that is nearly done."""
    owner = handshakes()
    going_on = begun(owner, "10.0.0.1")[0]
    going_on.has_response = True
    await asyncio.sleep(0.9 * SLOW)
    owner.step_due(going_on)
    await asyncio.sleep(0.001)
    begun(owner, *(f"10.0.1.{number}" for number in range(MOST - 1)))
    await asyncio.sleep(0.9 * SLOW)
    assert owner.make_room("10.0.2.1", asyncio.get_running_loop().time()) == TOO_MANY
    await asyncio.sleep(0.2 * SLOW)
    assert owner.make_room("10.0.2.1", asyncio.get_running_loop().time()) == ""
    owner.close()


def test_a_machine_that_stood_still_during_a_step_is_no_reason_to_wait() -> None:
    async def goes_on() -> bool:
        owner = handshakes()
        (stream,) = begun(owner, "10.0.0.1")
        stream.stands_still = 0.2
        owner.step_due(stream)
        await stream.has_stepped.wait()
        owner.step_due(stream)
        is_working = owner._is_working
        owner.close()
        return is_working

    assert asyncio.run(goes_on())
