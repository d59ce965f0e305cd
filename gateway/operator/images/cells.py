"""Values of images and mirrors, read without a client's request."""

import asyncio

from gateway.clock.slices import in_slices
from gateway.errors import ExceptionCode, Malformed, NotPermitted, WrongQuestion
from gateway.modbus.pdu import Span
from gateway.operator.images.grid import MOST, grid_of
from gateway.operator.images.kept import window
from gateway.operator.operations.answers.values import Cells
from gateway.operator.operations.asked import Addresses
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units.reached import readable_for
from gateway.operator.units.units import picture
from gateway.operator.values.reading_and_writing import points_at


async def tell_image(operator: Operator, asked: Addresses, asker: Asker) -> Cells:
    """Return what an image, mirror or virtual unit has at some addresses, with ages and last writers.

    Raises:
        WrongQuestion: there is no such image, the addresses are invalid, or the asker may not read them.
    """
    unit, area = picture(operator, asked.unit), asked.area
    points = points_at(asked, unit)
    span = Span(area, points[0].address, sum(point.count for point in points))
    if span.count > MOST:
        raise Malformed(f"{span.addresses}: at most {MOST} addresses at a time")
    if not readable_for(operator, unit, asker).has(span):
        why = f"[[access]] does not let {asker.caller.client} read {area} {span.addresses}"
        raise NotPermitted(why, ExceptionCode.ILLEGAL_FUNCTION)
    found = window(operator.gateway, unit.key, span, [span], asyncio.get_running_loop().time())
    if found is None:
        raise WrongQuestion(f"unit {unit.unit} is no image")
    rows = grid_of(found, area, points[0].type, points[0].swap).rows()
    values = await in_slices(cell for _, cells in rows for cell in cells)
    return Cells(unit=unit.unit, name=unit.name, area=area, stale_ms=found.stale_ms, values=values)
