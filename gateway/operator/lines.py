"""The operations `lines` and `line`."""

from gateway.errors import WrongQuestion
from gateway.operator.answers.status import AnyLine, Lines
from gateway.operator.asked import OneLine
from gateway.operator.operation import Asker, Nothing
from gateway.operator.operator import Operator
from gateway.operator.status import tell_status


async def tell_lines(operator: Operator, asked: Nothing, asker: Asker) -> Lines:
    """Return all client lines, server lines and upstreams."""
    status = await tell_status(operator, asked, asker)
    return Lines(status.lines, status.servers, status.upstreams)


async def tell_line(operator: Operator, asked: OneLine, asker: Asker) -> AnyLine:
    """Return the client line, server line or upstream of this name.

    Raises:
        WrongQuestion: there is none of this name.
    """
    status = await tell_status(operator, Nothing(), asker)
    known: tuple[AnyLine, ...] = (*status.lines, *status.servers, *status.upstreams)
    found = next((each for each in known if each.name == asked.name), None)
    if found is not None:
        return found
    raise WrongQuestion(f"there is no line {asked.name}")
