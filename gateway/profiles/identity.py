"""What tells that a unit is of a kind of device."""

from dataclasses import dataclass
from typing import NamedTuple

from gateway.modbus.codes import Area


class RegisterIdentity(NamedTuple):
    """A register that has this value in every device of the kind."""

    area: Area
    address: int
    equals: int


@dataclass(frozen=True, slots=True)
class Identity:
    """How a kind of device is recognised, by one of three: the others are empty.

    `fc43` is the beginning of an object that it tells with function 43/14 (A 6.21); `sunspec` are models that all have
    to be in its chain of SunSpec models, at the addresses that follow from its points.
    """

    fc43: str = ""
    register: RegisterIdentity | None = None
    sunspec: tuple[int, ...] = ()
