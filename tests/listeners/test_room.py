"""Who is let in, and who makes room for another client."""

from dataclasses import dataclass

import pytest

from gateway.listeners.room import refusal
from gateway.listeners.session import NO_RIGHTS, NO_ROOM
from gateway.routing.access import DEFAULT_ROWS, Door, Rights


@dataclass(eq=False)
class Client:
    host: str
    last_asked: float
    is_idle: bool = True


A, B, C = "10.0.0.1", "10.0.0.2", "10.0.0.3"


def let_in(present: list[Client], rights: Rights | None = None) -> tuple[str, list[Client]]:
    """Why C is not let in where there are three places, and who was dismissed for it."""
    dismissed: list[Client] = []
    rights = Rights(DEFAULT_ROWS, Door("scada")) if rights is None else rights
    return refusal(C, rights, present, 3, dismissed.append), dismissed


@pytest.mark.parametrize(
    ("present", "dismissed"),
    [
        ([Client(A, 3), Client(A, 1)], None),
        ([Client(A, 3), Client(B, 1), Client(C, 2)], 1),
        ([Client(A, 3), Client(B, 1), Client(A, 2)], 2),
        ([Client(A, 3, is_idle=False), Client(B, 1), Client(A, 4, is_idle=False)], 1),
        ([Client(A, 1, is_idle=False), Client(A, 2, is_idle=False), Client(A, 3)], 2),
    ],
)
def test_the_longest_idle_of_the_address_with_the_most_makes_room(present, dismissed) -> None:
    assert let_in(present) == ("", [] if dismissed is None else [present[dismissed]])


def test_nobody_who_waits_for_an_answer_makes_room() -> None:
    assert let_in([Client(A, each, is_idle=False) for each in range(3)]) == (NO_ROOM, [])


def test_nobody_makes_room_for_a_client_without_rights() -> None:
    assert let_in([Client(A, each) for each in range(3)], Rights((), Door("scada"))) == (NO_RIGHTS, [])
