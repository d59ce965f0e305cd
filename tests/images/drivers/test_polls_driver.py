"""Polls on the clock: the same for all that want something of a unit, as long as somebody does."""

import asyncio
import gc

from gateway.images.drivers.polls_driver import Pollers
from gateway.images.polled_range import Part, PollCounts
from gateway.images.polling import PolledUnit
from gateway.images.polls import Poll
from gateway.modbus.codes import Area
from gateway.profiles.read_rules import NO_RULES
from images.asking import image

UNIT = PolledUnit("shift", 9, NO_RULES)


class Reader:
    """Someone who wants holding register 0 each second."""

    def __init__(self, label):
        self.counts, self.label, self.place = PollCounts(), label, ""
        self.part = Part(Poll(Area.HOLDING, 0, 0, 1.0), self)

    def took(self, items, now):
        """Take nothing but the count."""

    def settle(self, now):
        """Nobody waits."""


async def test_an_image_has_the_same_polls_for_all_and_another_image_has_others():
    pollers = Pollers(asyncio.get_running_loop(), print)
    target, other = image(holding=((0, 9),)), image(holding=((0, 9),))
    polls = pollers.at_once(target, UNIT)
    assert pollers.at_once(target, UNIT) is polls
    assert pollers.at_once(other, UNIT) is not polls


async def test_polls_go_on_while_somebody_wants_them_and_are_forgotten_afterwards():
    pollers, one, other = Pollers(asyncio.get_running_loop(), print), Reader("mirror silo"), Reader("mqtt")
    target = image(holding=((0, 9),))
    polls = pollers.at_once(target, UNIT)
    polls.change(come=[one.part])
    polls.change(come=[other.part])
    await asyncio.sleep(5.5)
    assert (one.counts.polls, other.counts.polls) == (6, 6)
    assert polls.caller.client == "mirror silo, mqtt"
    polls.change(gone=[one.part])
    await asyncio.sleep(1.0)
    assert (one.counts.polls, other.counts.polls) == (6, 7)
    polls.change(gone=[other.part])
    await asyncio.sleep(1.0)
    assert (one.counts.polls, other.counts.polls) == (6, 7)
    del polls
    gc.collect()
    assert not list(pollers._drivers.values())
