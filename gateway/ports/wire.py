"""Whether a port transfers bytes at the line's rate, or at once."""

from typing import Final, Literal

#: `serial`: at the line's rate, `direct`: at once, `auto`: depending on the port.
Wire = Literal["auto", "serial", "direct"]

#: Major device numbers of pseudo-terminals (the kernel's devices.txt), which are virtual. `ttyACM` is not: real
#: adapters have that name too.
VIRTUAL_MAJORS: Final = range(136, 144)


def settled(wire: Wire, *, virtual: bool) -> Wire:
    """`serial` or `direct`: the meaning of `wire` on this port."""
    if wire != "auto":
        return wire
    return "direct" if virtual else "serial"
