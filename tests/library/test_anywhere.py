"""Methods that are awaited in another loop than the gateway's: what is said when that one cannot carry them out."""

import asyncio

import pytest

from gateway.library.anywhere import anywhere


class Asked:
    def __init__(self, loop):
        self._loop = loop

    @anywhere
    async def ask(self):
        return 5


@pytest.mark.parametrize(
    ("is_closed", "says"), [(False, "does not run: await this in that loop"), (True, "the gateway has stopped")]
)
def test_a_loop_that_stands_still_is_not_a_gateway_that_has_stopped(is_closed, says):
    loop = asyncio.new_event_loop()
    try:
        if is_closed:
            loop.close()
        with pytest.raises(RuntimeError, match=says):
            asyncio.run(Asked(loop).ask())
    finally:
        loop.close()
