"""The operations `lines` and `line`."""

from gateway.errors import WrongQuestion
from gateway.operator.operations.answers.status import AnyLine, Lines
from gateway.operator.operations.asked import OneLine
from gateway.operator.operations.operation import Asker, Nothing
from gateway.operator.operator import Operator
from gateway.operator.status.status import tell_status


async def tell_lines(operator: Operator, asked: Nothing, asker: Asker) -> Lines:
    """Return all lines and upstreams."""
    status = await tell_status(operator, asked, asker)
    return Lines(status.lines, status.servers, status.upstreams, status.monitors)


async def tell_line(operator: Operator, asked: OneLine, asker: Asker) -> AnyLine:
    """Return the line or upstream of this name.

    Raises:
        WrongQuestion: there is none of this name.
    """
    status = await tell_status(operator, Nothing(), asker)
    found = next((each for each in status.all_lines if each.name == asked.name), None)
    if found is not None:
        return found
    raise WrongQuestion(f"there is no line {asked.name}")
