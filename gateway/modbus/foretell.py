"""The size of a PDU, foretold from its first bytes: for those who cut a stream without knowing what was asked.

Both functions answer with the number of bytes that must be there before more can be said. Once that many are there, it
is the size of the PDU. 0 means that the function is not known and only silence ends the frame.
"""

from gateway.modbus.codes import EXCEPTION_BIT

#: Functions whose request has a fixed size.
_REQUEST_SIZES = {1: 5, 2: 5, 3: 5, 4: 5, 5: 5, 6: 5, 22: 7}
#: Functions whose request carries a byte count, and where.
_REQUEST_BYTE_COUNTS = {15: 5, 16: 5, 23: 9}
#: Functions whose response has a fixed size.
_RESPONSE_SIZES = {5: 5, 6: 5, 15: 5, 16: 5, 22: 7}
#: Functions whose response carries a byte count behind the function code.
_COUNTED_RESPONSES = frozenset({1, 2, 3, 4, 23})


def request_size(head: bytes) -> int:
    """Size of the request PDU that begins with `head`."""
    if not head:
        return 1
    function = head[0]
    at = _REQUEST_BYTE_COUNTS.get(function)
    if at is None:
        return _REQUEST_SIZES.get(function, 0)
    return at + 1 + (head[at] if len(head) > at else 0)


def response_size(head: bytes) -> int:
    """Size of the response PDU, normal or exception, that begins with `head`."""
    if not head:
        return 1
    function = head[0]
    if function & EXCEPTION_BIT:
        return 2
    if function in _COUNTED_RESPONSES:
        return 2 + (head[1] if len(head) > 1 else 0)
    return _RESPONSE_SIZES.get(function, 0)
