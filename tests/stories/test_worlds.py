"""The worlds of the soak with devices that tell when they held what: no answer is wrong, and each notices a lie."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import pytest

from gateway.errors import RequestError
from gateway.images.polled_range import Part
from gateway.images.polling import DevicePolls
from gateway.lines.ledger import Ledger
from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import Transaction
from gateway.modbus.mbap import TcpFrame
from gateway.runtime.gateway_line import GatewayLine
from gateway.upstreams.connection import Connection
from gateway.upstreams.in_flight import InFlight
from gateway.upstreams.upstream import Upstream
from soak.never_lies import run

Lie = Callable[[pytest.MonkeyPatch], None]


@pytest.mark.search
@pytest.mark.parametrize("world", ["bits", "mirrors", "reloads", "upstreams", "writers"])
def test_no_answer_is_wrong(world: str) -> None:
    tally = run(world, 2500, 0.2, seed=1)
    assert tally.wrong == []
    least = 800 if world == "bits" else 1500  # a write to bits is two transactions
    assert sum(count for (_, outcome), count in tally.outcomes.items() if outcome == "right data") > least
    assert min(tally.injected[fault] for fault in ("late", "silent", "exception")) > 20


def writes_leave_a_mirror_as_it_is(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(DevicePolls, "changed", lambda *_: None)


def a_mirror_has_no_stale_values(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Part, "is_lost", lambda part, now, stale, writes: False)


def a_line_that_keeps_its_name_keeps_its_devices(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GatewayLine, "means", lambda line, plan: (line.name, line.plan.port) == (plan.line.name, plan.port))


def an_upstream_takes_answers_in_the_order_of_requests(patch: pytest.MonkeyPatch) -> None:
    received = Upstream.received

    def in_order(upstream: Upstream, frames: Iterable[TcpFrame], now: float) -> None:
        for frame in frames:
            frame.transaction = next(iter(upstream._under_way), frame.transaction)
            received(upstream, [frame], now)

    patch.setattr(Upstream, "received", in_order)


def an_upstream_takes_any_identifier_where_it_may_be_0(patch: pytest.MonkeyPatch) -> None:
    take = InFlight.take

    def take_any(sent: InFlight, frame: TcpFrame, now: float) -> Transaction | None:
        return take(sent, TcpFrame(0, frame.unit, frame.pdu) if sent._is_zero else frame, now)

    patch.setattr(InFlight, "take", take_any)


def a_connection_whose_identifiers_say_nothing_is_kept(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Connection, "spoil", lambda *_: None)


def a_read_that_was_sent_is_shared(patch: pytest.MonkeyPatch) -> None:
    submit = Upstream.submit

    def join(upstream: Upstream, transaction: Transaction, now: float) -> None:
        for sent in upstream._sent.under_way.values():
            if (sent.device, sent.asked.data) == (transaction.device, transaction.asked.data):
                sent.requests += transaction.requests
                return
        submit(upstream, transaction, now)

    patch.setattr(Upstream, "submit", join)


def a_gap_passes_before_no_request(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Connection, "be_silent", lambda *_: None)


def writes_are_repeated_like_reads(patch: pytest.MonkeyPatch) -> None:
    give_up = Upstream._give_up

    def repeat(upstream: Upstream, identifier: int, transaction: Transaction, now: float) -> RequestError | None:
        transaction.asked = replace(transaction.asked, only_reads=True)
        return give_up(upstream, identifier, transaction, now)

    patch.setattr(Upstream, "_give_up", repeat)


def a_line_awaits_no_late_answers(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Ledger, "forbid_until", lambda *_: None)


def an_equal_read_overtakes_its_clients_write(patch: pytest.MonkeyPatch) -> None:
    patch.setattr("gateway.lines.turns.Row.holds_back", lambda *_: False)


def a_write_to_bits_waits_for_its_turn_between_read_and_write(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(WaitingQueue, "take_following", lambda _: None)


def an_upstream_sends_others_between_read_and_write(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Upstream, "_must_wait", lambda upstream, waiting: upstream._sent.is_asking(waiting))


@pytest.mark.search
@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("world", "lie"),
    [
        ("bits", a_write_to_bits_waits_for_its_turn_between_read_and_write),
        ("bits", an_upstream_sends_others_between_read_and_write),
        ("mirrors", writes_leave_a_mirror_as_it_is),
        ("mirrors", a_mirror_has_no_stale_values),
        ("reloads", a_line_that_keeps_its_name_keeps_its_devices),
        ("upstreams", an_upstream_takes_answers_in_the_order_of_requests),
        ("upstreams", an_upstream_takes_any_identifier_where_it_may_be_0),
        ("upstreams", a_connection_whose_identifiers_say_nothing_is_kept),
        ("upstreams", a_read_that_was_sent_is_shared),
        ("upstreams", a_gap_passes_before_no_request),
        ("upstreams", writes_are_repeated_like_reads),
        ("writers", a_line_awaits_no_late_answers),
        ("writers", an_equal_read_overtakes_its_clients_write),
    ],
)
def test_it_notices(world: str, lie: Lie, monkeypatch: pytest.MonkeyPatch) -> None:
    lie(monkeypatch)
    assert run(world, 5000 if world == "upstreams" else 1500, 0.2, seed=1).wrong_count > 0  # it has many servers
