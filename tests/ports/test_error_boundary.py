"""The error boundary of a part: it wakes the part in time, and what goes wrong in it ends there."""

import asyncio

from gateway.events import Event, PartFailed
from gateway.ports.error_boundary import ErrorBoundary


class FakePort:
    closed = False

    def close(self) -> None:
        self.closed = True


class Part:
    """A part with a port that does what a test wants."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.done: list[str] = []
        self.wants: float | None = None
        self.boundary = ErrorBoundary(
            "line hall-a",
            asyncio.get_running_loop(),
            self.events.append,
            deadline=lambda: self.wants,
            tick=self.tick,
            down=self.down,
        )
        self.boundary.port = self.port = FakePort()

    def tick(self) -> None:
        self.done.append("tick")
        self.wants = None

    def down(self) -> None:
        self.done.append("down")

    def plan(self, deadline: float) -> None:
        self.wants = deadline


def defect() -> None:
    raise ZeroDivisionError


async def test_a_part_is_woken_when_it_wants_to_be() -> None:
    part = Part()
    part.boundary.run(part.plan, 2.0)
    await asyncio.sleep(1.9)
    assert part.done == []
    assert (part.boundary.overdue(1.9), part.boundary.overdue(2.5)) == (0.0, 0.5)
    await asyncio.sleep(0.2)
    assert part.done == ["tick"]
    assert part.boundary.overdue(9.0) == 0.0


async def test_a_part_that_was_closed_is_not_woken() -> None:
    part = Part()
    part.boundary.run(part.plan, 2.0)
    part.boundary.close()
    await asyncio.sleep(3)
    assert part.done == []


async def test_a_port_that_has_gone_is_not_closed_and_the_part_knows() -> None:
    part = Part()
    part.boundary.lost()
    assert (part.done, part.boundary.port, part.port.closed) == (["down"], None, False)


async def test_a_defect_is_told_and_the_part_does_without_its_port() -> None:
    part = Part()
    part.boundary.run(defect)
    assert (part.done, part.boundary.port, part.port.closed) == (["down"], None, True)
    (told,) = part.events
    assert isinstance(told, PartFailed)
    assert (told.part, "ZeroDivisionError" in told.traceback) == ("line hall-a", True)


async def test_a_second_defect_is_told_too_and_the_port_is_closed_all_the_same() -> None:
    part = Part()
    part.boundary._down = defect
    part.boundary.run(defect)
    assert [type(event) for event in part.events] == [PartFailed, PartFailed]
    assert part.port.closed


async def test_a_part_without_a_port_fails_like_any_other() -> None:
    part = Part()
    part.boundary.port = None
    part.boundary.run(defect)
    assert part.done == ["down"]
    assert len(part.events) == 1
