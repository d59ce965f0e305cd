"""What the collector of reference cycles has to look at."""

import gc
import weakref

import pytest

from gateway.runtime.garbage import no_collection, pass_over_present, settle


class Part:
    """Holds itself, as parts that know each other do."""

    def __init__(self) -> None:
        self.other = self


@pytest.fixture(autouse=True)
def thaw():
    """Leave nothing excluded to other tests."""
    yield
    gc.unfreeze()


def test_a_collection_passes_over_what_was_there_before():
    part = Part()
    pass_over_present()
    later = Part()
    objects = gc.get_objects()
    assert not any(each is part for each in objects)
    assert any(each is later for each in objects)


def test_what_a_reload_leaves_behind_is_freed_when_it_settles():
    pass_over_present()
    part = Part()
    gone = weakref.ref(part)
    settle()
    del part
    assert gone() is not None
    settle()
    assert gone() is None


@pytest.fixture(params=[True, False], ids=["enabled", "disabled"])
def was_enabled(request):
    """Whether garbage is collected before an answer is made; a program around the gateway may not want it."""
    if not request.param:
        gc.disable()
    yield request.param
    gc.enable()


def test_while_answers_are_made_nothing_is_collected_and_then_as_before(was_enabled):
    with no_collection():
        with no_collection():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled() == was_enabled


def test_what_is_left_while_answers_are_made_is_bounded(monkeypatch):
    monkeypatch.setattr("gateway.runtime.garbage._MOST", 1000)
    with no_collection():
        left = [Part() for _ in range(2000)]
        with no_collection():
            assert gc.isenabled()
    assert len(left) == 2000


def test_what_settles_while_an_answer_is_made_has_garbage_collected_after_all_of_them():
    """A command collects nothing while it starts, and may be asked for its status then."""
    gc.disable()
    try:
        with no_collection():
            settle()
            with no_collection():
                assert not gc.isenabled()
        assert gc.isenabled()
    finally:
        gc.enable()
