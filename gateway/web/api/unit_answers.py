"""What the pages of a unit and of an image ask of the gateway behind them."""

from collections.abc import Sequence
from typing import Protocol

from gateway.modbus.pdu import Span
from gateway.operator.answer_times import FunctionTimes
from gateway.operator.failures import Failure
from gateway.operator.kept import ImageWindow, Kept


class UnitAnswers(Protocol):
    """See gateway.web.api.answers."""

    def may(self, unit: int, function: int, host: str) -> bool:
        """Whether [[access]] gives a client at this address the right to a function of a unit."""

    def target(self, unit: int) -> object:
        """What answers for a unit: the same object until a reload changes it; None if nothing does."""

    def answer_times(self, unit: int) -> Sequence[FunctionTimes]:
        """Those of a device, by function; none of a unit that the gateway answers itself."""

    def failures(self, unit: int, host: str) -> Sequence[Failure]:
        """The last failures of a unit that a reader at this address may see, the newest first, with what followed."""

    def kept(self, unit: int, spans: Sequence[Span]) -> Sequence[Kept | None]:
        """What is there of each span without a request: of an image, of a mirror, or of a device that has a mirror."""

    def mirrors_of(self, unit: int) -> Sequence[str]:
        """The names of the mirrors of a device."""

    def image(self, unit: int, span: Span) -> ImageWindow | None:
        """The part of an image or mirror at the addresses of `span`; None if the unit is neither."""
