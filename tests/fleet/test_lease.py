"""What the holder of a lease may do, and when another one takes it. What may never happen: test_lease_orders."""

from dataclasses import replace
from math import inf, nan

import pytest

from gateway.fleet.lease import Lease, LeaseSettings, Read, Write
from gateway.fleet.lease_entry import LeaseEntry

SETTINGS = LeaseSettings("hall-a", ttl=10.0, guard=1.5, late=4.0)
#: How long a holder may write after it has sent a renewal, and how often it sends one.
WRITES_FOR, STEP = 6.0, 2.0


class Store:
    """What the lease is kept in. It answers at once; `is_away`: not at all."""

    def __init__(self) -> None:
        self.value: bytes | None = None
        self.revision = 0
        self.is_away = False

    @property
    def entry(self) -> LeaseEntry:
        assert self.value is not None
        return LeaseEntry.decode(self.value, 1.0)

    def serve(self, lease: Lease, now: float) -> None:
        """Let it ask all that it wants to ask now."""
        for _ in range(5):
            asked = lease.next(now)
            if asked is None:
                assert lease.deadline() > now, "who waits for a time in the past waits for nothing"
                return
            if self.is_away:
                lease.failed("no answer", now)
            elif isinstance(asked, Read):
                lease.found(self.value, 0 if self.value is None else self.revision, now)
            elif asked.revision == (0 if self.value is None else self.revision):
                self.value, self.revision = asked.value, self.revision + 1
                lease.written(self.revision, now)
            else:
                lease.refused(now)
        raise AssertionError("it asks without end")

    def run(self, begin: float, end: float, *leases: Lease) -> float:
        """Let time pass: each asks when it wants to."""
        now = begin
        while now < end:
            for lease in leases:
                self.serve(lease, now)
            now = round(now + 0.1, 1)
        return now


def lease(name: str, settings: LeaseSettings = SETTINGS) -> Lease:
    return Lease(settings, name, f"process of {name}")


def held(store: Store, name: str = "a", settings: LeaseSettings = SETTINGS) -> tuple[Lease, float]:
    """A lease that is held and was silent for long enough, and the time."""
    one = lease(name, settings)
    now = store.run(0.0, 15.0, one)
    assert one.may_send(now)
    assert one.silent_until <= now
    return one, now


def test_a_lease_that_nobody_holds_is_taken_after_the_wait_and_used_after_a_silence():
    store, one = Store(), lease("a")
    now = store.run(0.0, 8.9, one)
    assert not one.is_held
    now = store.run(now, 9.2, one)
    assert one.is_held
    assert one.silent_until == pytest.approx(9.0 + SETTINGS.late)


def test_a_holder_renews_and_goes_on_for_ever():
    store = Store()
    one, now = held(store)
    now = store.run(now, 200.0, one)
    assert one.may_send(now)
    assert store.revision == pytest.approx(200 / STEP, abs=10)


def test_others_take_it_within_its_time_to_live():
    store = Store()
    one, now = held(store)
    other = lease("b")
    now = store.run(now, 20.0, one, other)
    assert (one.is_held, other.is_held, other.reason) == (True, False, "a holds it")
    died_at = now
    now = store.run(now, died_at + 7.0, other)
    assert not other.is_held
    store.run(now, died_at + SETTINGS.ttl, other)
    assert other.is_held
    assert other.silent_until >= died_at + SETTINGS.late


def test_without_an_answer_the_holder_stops_in_time_and_says_why():
    store = Store()
    one, now = held(store)
    store.is_away = True
    sent_at = one.until - WRITES_FOR
    store.run(now, sent_at + WRITES_FOR, one)
    assert not one.may_send(sent_at + WRITES_FOR)
    assert one.is_held, "an answer may still come, and so may a renewal"
    one.tick(sent_at + 7.5)
    assert (one.is_held, one.reason) == (False, "it could not be renewed in time: no answer")


def test_when_the_store_is_back_the_last_holder_has_it_again_at_once():
    store = Store()
    one, now = held(store)
    store.is_away = True
    now = store.run(now, 60.0, one)
    assert not one.is_held
    store.is_away = False
    now = store.run(now, 62.0, one)
    assert one.may_send(now)
    assert one.silent_until < now


def test_with_fallback_hold_it_goes_on_until_it_hears_of_another_holder():
    store = Store()
    one, now = held(store, settings=replace(SETTINGS, fallback="hold"))
    store.is_away = True
    now = store.run(now, 500.0, one)
    assert one.may_send(now)
    store.is_away = False
    store.value, store.revision = LeaseEntry("b", "process of b", 1, 10.0).encode(), store.revision + 1
    now = store.run(now, 502.5, one)
    assert (one.may_send(now), one.reason) == (False, "b holds it")


def test_a_lease_given_back_is_taken_at_once_with_what_was_left():
    store = Store()
    one, now = held(store)
    other = lease("b")
    now = store.run(now, 20.0, one, other)
    one.release(0.0, {"addresses": {"press": [6, 9]}})
    assert not one.may_send(now)
    now = store.run(now, 21.5, one, other)
    assert other.may_send(now)
    assert other.silent_until < now
    assert other.inherited == {"addresses": {"press": [6, 9]}}
    store.run(now, 60.0, one, other)
    assert not one.is_held, "who has given it back asks for it no more"


def test_what_moves_stands_in_the_entry_as_soon_as_it_is_so():
    store = Store()
    one, now = held(store)
    now = store.run(now, now + 0.2, one)
    one.state = {"rate": [9600, 19200]}
    store.serve(one, now)
    assert store.entry.state == {"rate": [9600, 19200]}
    other = lease("b")
    now = store.run(now, now + 12.0, other)
    assert other.inherited == {"rate": [9600, 19200]}
    assert store.entry.state == {"rate": [9600, 19200]}, "and if b is killed now, c is told as well"


def test_who_held_it_itself_inherits_nothing():
    store = Store()
    one, now = held(store)
    one.state = {"rate": [9600, 19200]}
    store.is_away = True
    now = store.run(now, 40.0, one)
    store.is_away = False
    now = store.run(now, 43.0, one)
    assert one.is_held
    assert one.inherited is None
    assert store.entry.state == {"rate": [9600, 19200]}


def test_who_hears_another_asker_stops_at_once_and_lets_others_go_first():
    store = Store()
    one, now = held(store)
    one.heard_other(now)
    assert not one.may_send(now)
    store.serve(one, now)
    assert (store.entry.is_released, store.entry.silent) == (True, SETTINGS.guard + SETTINGS.late)
    now = store.run(now, now + SETTINGS.ttl - 0.5, one)
    assert not one.is_held
    store.run(now, now + 1.0, one)
    assert one.is_held


def test_a_release_that_is_written_late_is_followed_by_a_claim_at_once():
    store = Store()
    one, now = held(store)
    one.heard_other(now)
    now += 12.0  # for so long it was stopped
    asked = one.next(now)
    assert isinstance(asked, Write)
    store.value, store.revision = asked.value, store.revision + 1
    one.written(store.revision, now)
    store.serve(one, now)
    assert one.is_held


def test_who_cannot_use_the_line_gives_way_and_takes_it_again_if_nobody_does():
    store = Store()
    one, now = held(store)
    one.give_way(now, "the port cannot be used from here")
    now = store.run(now, now + 2.5, one)
    assert not one.is_held
    store.run(now, now + 2.0, one)
    assert one.is_held


def test_a_renewal_whose_answer_was_lost_counts_when_it_is_found():
    store = Store()
    one, now = held(store)
    asked = None
    while asked is None:
        now += 0.1
        asked = one.next(now)
    assert isinstance(asked, Write)
    store.value, store.revision = asked.value, store.revision + 1
    one.failed("the answer was lost", now + 1.0)
    store.run(round(now + 1.0, 1), now + 4.0, one)
    assert one.may_send(now + 4.0)


def test_it_waits_for_what_the_holder_calls_its_time_to_live():
    store = Store()
    store.value, store.revision = LeaseEntry("a", "process of a", 1, 100.0).encode(), 7
    other = lease("b")
    now = store.run(0.0, 89.0, other)
    assert not other.is_held
    store.run(now, 91.0, other)
    assert other.is_held


@pytest.mark.parametrize(
    "value",
    [
        *(b"", b"\xff", b"[]", b"{}", b"null", b"[" * 60_000, b'{"holder":' * 6_000),
        *(LeaseEntry("a", "x", 1, ttl).encode() for ttl in (-1.0, 1e9, inf, nan)),
        LeaseEntry("a", "x", 1, 10.0, silent=nan).encode(),
        LeaseEntry("a", "x", 1, 10.0, state={"late": {"at": inf}}).encode(),
        LeaseEntry("a", "x", 1, 10.0, state={"late": [nan]}).encode(),
        LeaseEntry("a", "x", 1, 10.0).encode().replace(b"{}", b'{"a": ' * 300 + b"1" + b"}" * 300),
        LeaseEntry("a\n", "x", 1, 10.0).encode(),
        LeaseEntry("\ud800", "x", 1, 10.0).encode(),
        LeaseEntry("a" * 501, "x", 1, 10.0).encode(),
        LeaseEntry("a", "x", 1, 10.0).encode().replace(b"1,", b"9" * 5000 + b",", 1),
    ],
    ids=str,
)
def test_an_entry_that_cannot_be_read_is_somebody_elses(value):
    store, one = Store(), lease("a")
    store.value, store.revision = value, 3
    now = store.run(0.0, 8.9, one)
    assert (one.is_held, one.reason) == (False, "somebody whose entry cannot be read holds it")
    store.run(now, 9.3, one)
    assert one.is_held


def test_an_entry_that_cannot_be_read_may_be_of_whoever_lives_longest():
    store, one = Store(), lease("a")
    store.value, store.revision = LeaseEntry("b", "process of b", 1, 100.0).encode(), 3
    now = store.run(0.0, 5.0, one)
    store.value, store.revision = b"", 4
    now = store.run(now, 94.0, one)
    assert not one.is_held
    store.run(now, 97.0, one)
    assert one.is_held


@pytest.mark.parametrize("is_released", [False, True])
def test_an_older_entry_counts_as_lost_even_if_it_is_ours_or_free(is_released: bool):
    store = Store()
    one, now = held(store)
    instance = "process of c" if is_released else "process of a"
    older = LeaseEntry("c", instance, 1, 10.0, is_released=is_released).encode(), store.revision
    one.heard_other(now)
    store.value, store.revision = LeaseEntry("b", "process of b", 1, 20.0).encode(), store.revision + 5
    now = store.run(now, now + 3.0, one)
    assert one.reason == "b holds it"
    store.value, store.revision = older
    came_back_at, now = now, store.run(now, now + 17.5, one)
    assert (one.is_held, one.reason) == (False, "NATS came back with an older entry; it may be taken soon")
    now = store.run(now, now + 2.5, one)
    assert one.is_held
    assert one.silent_until >= came_back_at + 18.0 + SETTINGS.late


def test_a_holder_gives_way_to_an_older_entry_of_another_one_and_says_why():
    store = Store()
    one, now = held(store)
    one.found(LeaseEntry("b", "process of b", 1, 10.0).encode(), store.revision - 1, now)
    assert (one.is_held, one.reason) == (False, "NATS came back with an older entry")


def test_a_holder_writes_its_entry_again_when_the_store_has_lost_it():
    store = Store()
    one, now = held(store)
    store.value, store.revision = None, 0
    now = store.run(now, now + STEP + 0.2, one)
    assert one.may_send(now)
    assert store.entry.holder == "a"


def test_who_was_stopped_for_long_knows_it_by_its_clock():
    store = Store()
    one, now = held(store)
    assert not one.may_send(now + 60.0)
    one.tick(now + 60.0)
    assert not one.is_held


def test_a_share_counts_from_the_sending_of_a_renewal_not_from_its_answer():
    store = Store()
    one, now = held(store)
    asked = None
    while asked is None:
        now += 0.1
        asked = one.next(now)
    one.written(store.revision + 1, now + 1.5)
    assert one.until == pytest.approx(now + WRITES_FOR)


def test_who_could_not_see_an_empty_store_for_a_moment_waits_anew():
    store = Store()
    other = lease("b")
    now = store.run(0.0, 8.5, other)
    store.is_away = True  # meanwhile a has taken the lease, and the store has lost that
    now = store.run(now, 10.0, other)
    store.is_away = False
    now = store.run(now, 18.5, other)
    assert not other.is_held
    store.run(now, 20.5, other)
    assert other.is_held


def test_who_gives_it_back_while_it_is_silent_tells_for_how_long_still():
    store = Store()
    store.value, store.revision = LeaseEntry("a", "process of a", 1, 10.0).encode(), 7
    other = lease("b")
    now = store.run(0.0, 9.5, other)
    assert other.silent_until > now
    other.release(0.0, {})
    store.serve(other, now)
    assert store.entry.silent == pytest.approx(other.silent_until - now)
