"""Subscriptions to units, in virtual time."""

import asyncio

from gateway.fleet.calls import ANSWER_TIME
from gateway.fleet.connection import unsubscribe
from gateway.fleet.serving import Serving


class Connection:
    def __init__(self) -> None:
        self.may_subscribe = asyncio.Event()
        self.subscribed: list[str] = []
        self.most_waiting: list[int] = []

    async def subscribe(self, subject, _deliver, _queue, most):
        await self.may_subscribe.wait()
        self.subscribed.append(subject)
        self.most_waiting.append(most)

        async def end() -> None:
            self.subscribed.remove(subject)

        return end

    def publish(self, _message):
        return True


async def test_a_connection_that_is_lost_while_it_subscribes_leaves_nothing_to_the_next_one():
    serving = Serving("s", "a", None, lambda: 0.0, lambda _: None)
    await serving.serve(lambda: [1, 2])
    slow, second = Connection(), Connection()
    second.may_subscribe.set()
    first_call = asyncio.create_task(serving.connected(slow))
    await asyncio.sleep(0.1)
    serving.disconnected()
    second_call = asyncio.create_task(serving.connected(second))
    await asyncio.sleep(0.1)
    slow.may_subscribe.set()
    await asyncio.gather(first_call, second_call)
    serving.disconnected()
    assert second.subscribed == ["mbgw.s.unit.1.from.*", "mbgw.s.unit.2.from.*"]


async def test_256_requests_to_each_unit_wait_at_most():
    """Four sites send all that they may have under way. What is lost beyond that: system/test_fleet_connection."""
    serving, connection = Serving("s", "a", None, lambda: 0.0, lambda _: None), Connection()
    connection.may_subscribe.set()
    await serving.serve(lambda: [1, 2])
    await serving.connected(connection)
    serving.disconnected()
    assert connection.most_waiting == [256, 256]


async def test_the_end_of_a_subscription_that_is_not_taken_is_not_waited_for_longer():
    class Hanging:
        async def unsubscribe(self):
            await asyncio.Event().wait()

    async with asyncio.timeout(3 * ANSWER_TIME):
        await unsubscribe(Hanging())
