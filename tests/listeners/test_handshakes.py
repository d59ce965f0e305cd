"""Which clients may begin a handshake while many are not done."""

from typing import Any

from gateway.listeners.handshakes import (
    MADE_ROOM,
    MOST,
    MOST_OF_ONE,
    SILENT,
    TOO_MANY,
    TOO_MANY_OF_ONE,
    ConnectingClient,
    Handshakes,
)


class Stream:
    """A TlsStream whose client says nothing."""

    def __init__(self, owner: Handshakes) -> None:
        self._owner: Any = owner
        self.refused = ""

    def start(self) -> None:
        pass

    def refuse(self, reason: str) -> None:
        self.refused = reason
        self._owner.not_secured(self, reason)


def begun(owner: Handshakes, *origins: str) -> list[Stream]:
    streams: list[Any] = []
    for origin in origins:
        assert owner.trouble(origin, 0.0) == ""
        streams.append(Stream(owner))
        owner.begin(streams[-1], ConnectingClient(origin, f"{origin}:1", origin), 0.0)
    return streams


def handshakes() -> Handshakes:
    return Handshakes(lambda *_: None, lambda *_: None)


def test_one_address_has_few_of_them() -> None:
    owner = handshakes()
    begun(owner, *["10.0.0.1"] * MOST_OF_ONE)
    assert owner.trouble("10.0.0.1", 0.0) == TOO_MANY_OF_ONE
    assert owner.trouble("10.0.0.2", 0.0) == ""


def test_the_address_with_most_of_them_makes_room() -> None:
    owner = handshakes()
    once, *_ = begun(owner, "10.0.1.1")
    twice, _ = begun(owner, "10.0.1.2", "10.0.1.2")
    begun(owner, *(f"10.0.0.{number}" for number in range(MOST - 3)))
    assert owner.trouble("10.0.2.1", 0.0) == ""
    assert (once.refused, twice.refused) == ("", MADE_ROOM)


def test_if_each_address_has_one_the_oldest_silent_one_makes_room_but_for_no_second_one() -> None:
    owner = handshakes()
    active, silent, *_, last = begun(owner, *(f"10.0.0.{number}" for number in range(MOST)))
    owner._is_working = True  # no step begins
    owner.step_due(active)
    assert owner.trouble("10.0.2.1", SILENT - 0.1) == TOO_MANY
    assert owner.trouble("10.0.0.7", SILENT) == TOO_MANY
    assert owner.trouble("10.0.2.1", SILENT) == ""
    assert (active.refused, silent.refused, last.refused) == ("", MADE_ROOM, "")
