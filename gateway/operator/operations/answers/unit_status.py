"""A unit as clients see it, with its status."""

from dataclasses import dataclass

from gateway.operator.operations.answers.status import ImageStatus, MirrorStatus, UnitStatus, VirtualStatus
from gateway.operator.operations.answers.unit import UnitPicture


@dataclass(frozen=True, slots=True)
class UnitWithStatus(UnitPicture):
    """A unit as clients see it, its points, and its part of the status, if it has one."""

    status: UnitStatus | MirrorStatus | VirtualStatus | ImageStatus | None
