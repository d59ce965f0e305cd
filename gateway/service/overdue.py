"""Late answers that outlive the line that has asked: they come on its port, whatever line is there then."""

import os
from collections.abc import Iterable

from gateway.lines.late import Overdue
from gateway.ports.port import PortSettings, TcpSettings

#: What a line's port is known by: see `places`.
Places = frozenset[str]


def places(name: str, port: PortSettings) -> Places:
    """What the port of the line `name` is known by. Two that have one of these in common may be the same wire.

    These are the line's name, the port as the config writes it, and the device that this leads to at the moment.
    """
    place = f"{port.host.lower()}:{port.number}" if isinstance(port, TcpSettings) else os.path.realpath(port.port)
    return frozenset((name, port.port, place))


class LeftBehind:
    """The late answers that were still awaited when lines ended, until they can come no more."""

    def __init__(self) -> None:
        self._answers: set[tuple[Places, Overdue]] = set()

    def leave(self, at: Places, answers: Iterable[Overdue]) -> None:
        """A line on this port has ended, and awaited these."""
        self._answers |= {(at, each) for each in answers}

    def awaited(self, at: Places, now: float) -> list[Overdue]:
        """What may still come on this port."""
        self._answers = {(there, each) for there, each in self._answers if each.ends_at > now}
        return [each for there, each in self._answers if there & at]
