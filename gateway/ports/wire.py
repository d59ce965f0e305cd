"""Whether a port transfers bytes at the line's rate, or at once."""

from typing import Literal

#: `serial`: at the line's rate, `direct`: at once, `auto`: depending on the port.
Wire = Literal["auto", "serial", "direct"]


def settled(wire: Wire, *, virtual: bool) -> Wire:
    """`serial` or `direct`: the meaning of `wire` on this port."""
    if wire != "auto":
        return wire
    return "direct" if virtual else "serial"
