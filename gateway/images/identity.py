"""Functions 17 and 43/14 of an image: its identification (A 6.13, 6.21)."""

from typing import Final

from gateway import __version__
from gateway.errors import IllegalDataAddress, IllegalFunction
from gateway.modbus.codes import DEVICE_IDENTIFICATION, MAX_PDU, ONE_OBJECT

VENDOR: Final = "modbus-gateway"
PRODUCT: Final = "register image"

#: Identifiers of objects (A 6.21). The first three are the basic ones.
_VENDOR_NAME, _PRODUCT_CODE, _REVISION, _APPLICATION_NAME = 0, 1, 2, 6
#: The code for the basic objects only.
_BASIC: Final = 1
#: Conformity level: basic and regular objects, as a stream and one by one.
_REGULAR: Final = 0x82
#: More objects follow.
_MORE: Final = 0xFF

#: Bytes of an identification before its first object, and of an object before its value.
_HEAD_SIZE: Final = 7
_OBJECT_HEAD_SIZE: Final = 2
#: The longest value that fits into one response.
_LONGEST_VALUE: Final = MAX_PDU - _HEAD_SIZE - _OBJECT_HEAD_SIZE

#: An image always runs.
_RUNNING: Final = b"\xff"


class Identity:
    """The identification of an image. Its name is sent in ASCII, and cut if it is too long for a response."""

    def __init__(self, name: str, product: str = PRODUCT) -> None:
        texts = {_VENDOR_NAME: VENDOR, _PRODUCT_CODE: product, _REVISION: __version__, _APPLICATION_NAME: name}
        self._objects = {number: text.encode("ascii", "replace")[:_LONGEST_VALUE] for number, text in texts.items()}

    def report(self, pdu: bytes) -> bytes:
        """Function 17: its name, and that it runs."""
        data = self._objects[_APPLICATION_NAME] + _RUNNING
        return bytes((pdu[0], len(data))) + data

    def identify(self, pdu: bytes) -> bytes:
        """Function 43: its objects from the requested one on, as many as fit.

        Raises:
            IllegalFunction: the type is not 14.
            IllegalDataAddress: there is no such single object.
        """
        if pdu[1] != DEVICE_IDENTIFICATION:
            raise IllegalFunction(f"an image has no type {pdu[1]} of function 43")
        code, first = pdu[2], pdu[3]
        if code != ONE_OBJECT:
            return self._stream(pdu, self._asked(code, first))
        if first not in self._objects:
            raise IllegalDataAddress(f"an image has no object {first}")
        return self._stream(pdu, [first])

    def _asked(self, code: int, first: int) -> list[int]:
        """The objects from `first` on, all of them if there is no such one (A 6.21)."""
        numbers = [number for number in self._objects if code != _BASIC or number <= _REVISION]
        return numbers[numbers.index(first) :] if first in numbers else numbers

    def _stream(self, pdu: bytes, numbers: list[int]) -> bytes:
        count, data = 0, b""
        for number in numbers:
            value = self._objects[number]
            if _HEAD_SIZE + len(data) + _OBJECT_HEAD_SIZE + len(value) > MAX_PDU:
                return pdu[:3] + bytes((_REGULAR, _MORE, number, count)) + data
            data += bytes((number, len(value))) + value
            count += 1
        return pdu[:3] + bytes((_REGULAR, 0, 0, count)) + data
