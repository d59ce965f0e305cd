"""What one table of the config needs, once its parts are joined."""

import pytest

from kit.gateway_bench import GatewayBench

LINE = """
[[line]]
name = "hall-a"
port = "/dev/hall-a"
max_wait = "3 s"
devices = [{ unit = 1, timeout = "500 ms" }, { unit = 2, timeout = "800 ms" }]
"""


async def test_an_answer_may_come_until_the_late_window_of_the_slowest_device_ends() -> None:
    (by_itself,) = GatewayBench(LINE).gateway.parts
    (given,) = GatewayBench(LINE + 'late_window = "10 s"').gateway.parts
    limit = given.longest_wait["hall-a/2"] - 3.0
    assert limit > 0.8
    assert by_itself.patience == pytest.approx(3 * limit)
    assert given.patience == pytest.approx(limit + 10.0)
