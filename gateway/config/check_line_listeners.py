"""Cross-checks of listeners for one line."""

from collections.abc import Iterator

from gateway.config.check_units import client_lines
from gateway.config.problem import Problem, did_you_mean, error, warning
from gateway.config.schema import Config, Line, Listen
from gateway.config.unitset import show_units
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT


def check_line_listeners(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Each names a client line, and its keys fit that line. `failed` as in `check`."""
    lines = {line.label: line for line in client_lines(config)}
    for listen in config.listen:
        if listen.line in lines:
            yield from _check_reach(listen, lines[listen.line])
        elif listen.line is not None and "line" not in failed:
            yield error((*listen.path, "line"), *_no_such_line(listen.line, config))


def addresses_on(line: Line) -> frozenset[int]:
    """The addresses of a line that a listener for it leads to."""
    if line.devices is None:
        return frozenset(range(FIRST_UNIT, LAST_UNIT + 1))
    return frozenset(unit for row in line.devices for unit in row.units) - {BROADCAST_UNIT}


def _no_such_line(name: str, config: Config) -> tuple[str, str]:
    """The error and the remedy."""
    if any(line.label == name for line in config.line):
        return f'line "{name}" is a server line', "leave line out: every listener leads to the units that it serves"
    return f'there is no line "{name}"', did_you_mean(name, [line.label for line in client_lines(config)])


def _check_reach(listen: Listen, line: Line) -> Iterator[Problem]:
    addresses = addresses_on(line)
    if not addresses:
        what = f'no device of line "{line.label}" has an address, so nothing can be asked'
        yield error((*listen.path, "line"), what, "name its address as unit, or leave line out")
    elif isinstance(listen.unit0, int) and listen.unit0 not in addresses:
        what = f'{listen.unit0} is not an address on line "{line.label}"'
        yield error((*listen.path, "unit0"), what, f"its addresses: {show_units(addresses)}")
    if listen.unit0 == "broadcast" and not line.broadcast:
        yield warning((*listen.path, "unit0"), f'line "{line.label}" takes no broadcasts', "see its key broadcast")
