"""A unit, as clients have to know it, with how it is doing."""

from dataclasses import dataclass

from gateway.operator.answers.status import ImageStatus, MirrorStatus, UnitStatus
from gateway.operator.answers.unit import UnitPicture


@dataclass(frozen=True, slots=True)
class UnitWithStatus(UnitPicture):
    """A unit for clients, its points, and its part of the status, if it has one."""

    status: UnitStatus | MirrorStatus | ImageStatus | None
