"""What the collector of reference cycles has to look at."""

import gc
import weakref

from gateway.runtime.garbage import settle


class Part:
    """Holds itself, as parts that know each other do."""

    def __init__(self) -> None:
        self.other = self


def test_a_collection_passes_over_what_was_there_before():
    part = Part()
    settle()
    later = Part()
    objects = gc.get_objects()
    assert not any(each is part for each in objects)
    assert any(each is later for each in objects)


def test_what_a_reload_leaves_behind_is_freed_when_it_settles():
    part = Part()
    settle()
    gone = weakref.ref(part)
    del part
    settle()
    assert gone() is None
