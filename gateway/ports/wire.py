"""Whether the bytes of a port take their time on a wire, or come at once."""

from typing import Final, Literal

#: How bytes travel: `serial` at the line's rate, `direct` at once, `auto` as the port says.
Wire = Literal["auto", "serial", "direct"]

#: Majors of pseudo-terminals' device ends (the kernel's devices.txt): virtual ports. `ttyACM` is none of them: real
#: adapters are called so, too.
VIRTUAL_MAJORS: Final = range(136, 144)


def settled(wire: Wire, *, virtual: bool) -> Wire:
    """What `wire` is, `serial` or `direct`, on a port that is `virtual` or is not."""
    if wire != "auto":
        return wire
    return "direct" if virtual else "serial"
