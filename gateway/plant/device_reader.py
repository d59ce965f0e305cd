"""Wants the published points of a device of its polls."""

from collections.abc import Sequence
from typing import Protocol

from gateway.images.polled_range import Part, PollCounts
from gateway.images.polls import Poll
from gateway.modbus.pdu import Span
from gateway.plant.commands import CLIENT
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice


class Polled(Protocol):
    """The polls of a device."""

    def change(self, come: Sequence[Part] = (), gone: Sequence[Part] = ()) -> None:
        """Poll for the parts that `come`, and no more for those that are `gone`."""

    def wrote(self, span: Span | None) -> None:
        """Note that a write to `span` has finished, or one to any address if that is None."""


class TakesReadings(Protocol):
    """Takes what was read of a device."""

    def took(self, device: str, items: Sequence[tuple[Point, bytes]], now: float) -> None:
        """Take the items of points that one request has read."""

    def missed(self, device: str, now: float, *, answers: bool | None) -> None:
        """Note that a request has read nothing. `answers`: whether the device answers; None if it was not asked."""


class DeviceReader:
    """A Reader that hands on the items of a device's points. `place` is that of the table in the config."""

    label = CLIENT

    def __init__(self, device: PublishedDevice, place: str, counts: PollCounts, readings_to: TakesReadings) -> None:
        self.counts = counts
        self.place = place
        self._device = device.name
        self._readings_to = readings_to
        readable = [each for each in device.points if each.is_readable]
        self._points = {Part(Poll.of(each.point, each.every), self): each.point for each in readable}

    @property
    def parts(self) -> tuple[Part, ...]:
        """What it wants: the addresses that are read for each point."""
        return tuple(self._points)

    def took(self, items: Sequence[tuple[Part, bytes]], now: float) -> None:
        """Hand on the items of the points."""
        self._readings_to.took(self._device, [(self._points[part], own) for part, own in items], now)

    def missed(self, parts: Sequence[Part], now: float, *, answers: bool | None) -> None:  # noqa: ARG002 - one request
        """Hand on that there was no answer: one request is one failure, however many points it reads."""
        self._readings_to.missed(self._device, now, answers=answers)

    def settle(self, parts: Sequence[Part], now: float) -> None:
        """Do nothing: nobody waits for a poll."""
