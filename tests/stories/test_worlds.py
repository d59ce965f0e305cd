"""The worlds of the soak with devices that tell when they held what: no answer is wrong, and each notices a lie."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import pytest

from gateway.errors import RequestError
from gateway.images.drivers.polls_driver import Pollers, PollsDriver
from gateway.images.heard_values import HeardValues
from gateway.images.mirror import Mirror
from gateway.images.ordered import ClientRequests
from gateway.images.polled_range import Part
from gateway.images.polling import DevicePolls, PolledTarget, PolledUnit
from gateway.images.virtual.block import Block
from gateway.images.virtual.layout import Touched
from gateway.images.virtual.row import Freshness, Row
from gateway.images.virtual.unit import VirtualUnit
from gateway.images.virtual.writes import write_to
from gateway.library.unit_client import UnitClient
from gateway.lines.last_reads import LastReads
from gateway.lines.ledger import Ledger
from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import Transaction
from gateway.modbus.mbap import TcpFrame
from gateway.modbus.pdu import RequestPdu, Span
from gateway.operator.operator import Operator
from gateway.operator.values.requests import AwaitedOrigin
from gateway.profiles.conversion import Conversion
from gateway.profiles.guards import Guard
from gateway.profiles.writing import Write
from gateway.request import Request
from gateway.routing.access import EntryPoint
from gateway.routing.audit import AuditedOrigin
from gateway.routing.rights import Rights
from gateway.runtime.gateway import Gateway
from gateway.runtime.gateway_line import GatewayLine
from gateway.upstreams.connection import Connection
from gateway.upstreams.in_flight import InFlight
from gateway.upstreams.upstream import Upstream
from soak.never_lies import WORLDS, run
from soak.noticing import is_noticed

Lie = Callable[[pytest.MonkeyPatch], None]


@pytest.mark.search
@pytest.mark.parametrize(
    "world", ["bits", "maps", "mirrors", "monitors", "programs", "reloads", "rights", "upstreams", "writers"]
)
def test_no_answer_is_wrong(world: str) -> None:
    tally = run(world, 2500, 0.2, seed=1)
    assert tally.wrong == []
    # A write to bits is two transactions; what only passes is often in doubt.
    least = {"bits": 800, "monitors": 1000}.get(world, 1500)
    assert sum(count for (_, outcome), count in tally.outcomes.items() if outcome == "right data") > least
    assert min(tally.injected[fault] for fault in ("late", "silent", "exception")) > 20


def writes_leave_a_mirror_as_it_is(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(DevicePolls, "changed", lambda *_: None)


def a_mirror_has_no_stale_values(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Part, "is_lost", lambda part, now, stale, writes: False)


def writes_of_others_leave_a_mirror_as_it_is(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(HeardValues, "changed", lambda *_: None)


def what_is_heard_is_as_old_as_its_answer(patch: pytest.MonkeyPatch) -> None:
    heard = HeardValues.heard
    patch.setattr(HeardValues, "heard", lambda values, told, now: heard(values, replace(told, asked_at=now), now))


def what_was_heard_is_never_stale(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Part, "is_lost", lambda part, now, stale, writes: part.sampled_at is None)
    patch.setattr(Mirror, "_at_once", lambda *_: None)


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


def a_row_takes_what_its_neighbour_has_read(patch: pytest.MonkeyPatch) -> None:
    took = VirtualUnit.took

    def mixed(unit: VirtualUnit, items: Sequence[tuple[Part, bytes]], now: float) -> None:
        others = [own for _, own in items[1:] + items[:1]]
        took(unit, [(row, b if len(a) == len(b) else a) for (row, a), b in zip(items, others, strict=True)], now)

    patch.setattr(VirtualUnit, "took", mixed)


def half_of_a_row_is_of_the_poll_before(patch: pytest.MonkeyPatch) -> None:
    take = Row.take

    def take_half(row: Row, items: bytes) -> bytes | None:
        before, half = row.items, len(items) // 4 * 2
        return take(row, items if before is None or not half else items[:half] + before[half:])

    patch.setattr(Row, "take", take_half)


def rows_are_never_stale(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Row, "is_lost", lambda row, now, stale, writes: row.sampled_at is None and not row.is_awaited)
    patch.setattr(Freshness, "lasts", lambda fresh, *_: all(row.since(0.0, 0.0) is not None for row in fresh.rows))


def fresh_rows_are_filled_with_their_number(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Row, "is_missing", lambda row, *_: row.mapped.when_stale not in ("exception", "hold"))
    patch.setattr(Freshness, "lasts", lambda *_: False)


def a_fresh_bit_is_1_while_any_row_is_fresh(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(
        Block,
        "is_device_fresh",
        lambda block, device, now: any(row.since(now, block.stale) for row in block.by_device[device].rows),
    )


def a_fresh_bit_is_0_after_a_failed_poll(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(
        Block,
        "is_device_fresh",
        lambda block, device, now: all(
            row.is_awaited and row.since(now, block.stale) for row in block.by_device[device].rows
        ),
    )


def an_age_is_that_of_any_device(patch: pytest.MonkeyPatch) -> None:
    def age(block: Block, _: str, now: float) -> float | None:
        return now - max((row.sampled_at for row in block.rows if row.sampled_at is not None), default=now)

    patch.setattr(Block, "age_of", age)


def a_write_to_a_row_begins_where_the_row_does(patch: pytest.MonkeyPatch) -> None:
    def moved(row: Row, asked: RequestPdu, *others: object) -> Write:
        found = write_to(row, asked, *others)
        if row.mapped.point is not None:
            return found
        return Write(found.pdu[:1] + row.poll.first.to_bytes(2) + found.pdu[3:], found.span)

    patch.setattr("gateway.images.virtual.unit.write_to", moved)


def a_value_is_written_as_the_client_has_it(patch: pytest.MonkeyPatch) -> None:
    back = Conversion.__call__

    def as_it_is(conversion: Conversion, items: bytes, before: bytes | None = None) -> bytes | None:
        is_back = conversion.target.write != "no" and conversion.source is not conversion.target
        found = back(conversion, items, before)
        return items[: len(found)] if found is not None and is_back else found

    patch.setattr(Conversion, "__call__", as_it_is)


def a_read_does_not_wait_for_its_clients_write(patch: pytest.MonkeyPatch) -> None:
    handle = VirtualUnit._handle

    def at_once(unit: VirtualUnit, request: Request, row: ClientRequests, now: float) -> bytes | None:
        under_way, row.under_way = row.under_way, 0
        try:
            return handle(unit, request, row, now)
        finally:
            row.under_way += under_way

    patch.setattr(VirtualUnit, "_handle", at_once)


def a_write_leaves_fresh_what_is_fresh(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Row, "changed", lambda *_: None)


def a_row_has_what_another_one_had_before_a_reload(patch: pytest.MonkeyPatch) -> None:
    def take_over(block: Block, old: Block) -> None:
        before = {row.place: row for row in old.rows}
        for row in block.rows:
            if row.place in before:
                row.take_over(before[row.place])
                block._tables[row.place.area].write(row.place, old.values(Touched(row.place, b"", ()), 0.0))

    patch.setattr(Block, "take_over", take_over)


def a_swap_of_devices_leaves_their_polls(patch: pytest.MonkeyPatch) -> None:
    by_name: dict[str, PollsDriver] = {}
    of = Pollers.of

    def of_name(pollers: Pollers, target: PolledTarget, unit: PolledUnit, line: str = "") -> PollsDriver:
        return by_name.setdefault(unit.name, of(pollers, target, unit, line))

    patch.setattr(Pollers, "of", of_name)


def what_was_read_before_a_write_is_shown(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(LastReads, "written", lambda *_: None)


def what_another_device_has_answered_is_shown(patch: pytest.MonkeyPatch) -> None:
    reads, answered = LastReads(), LastReads.answered
    patch.setattr(LastReads, "of", lambda _, unit: list(reads._by_request.values()))
    patch.setattr(LastReads, "answered", lambda _, *answer: answered(reads, *answer))


def a_reload_keeps_what_is_shown_by_the_unit_alone(patch: pytest.MonkeyPatch) -> None:
    known: dict[tuple[str, int], LastReads] = {}

    def keep(_before: Gateway, now: Gateway) -> None:
        for owner in now.owners:
            for device in owner.devices.values():
                device.last_reads = known.setdefault((owner.name, device.settings.unit), LastReads())

    patch.setattr("gateway.runtime.running.keep_reads", keep)


def a_read_is_allowed_by_its_first_address(patch: pytest.MonkeyPatch) -> None:
    ruling = Rights.ruling

    def of_first(rights: Rights, host: str, unit: int, pdu: bytes) -> object:
        return ruling(rights, host, unit, pdu[:3] + b"\0\1" if pdu[0] in (3, 4) else pdu)

    patch.setattr(Rights, "ruling", of_first)


def a_reload_leaves_the_rights(patch: pytest.MonkeyPatch) -> None:
    first: dict[EntryPoint, Rights] = {}
    patch.setattr(
        "gateway.runtime.running.Rights",
        lambda rows, entry, known_as: first.setdefault(entry, Rights(rows, entry, known_as)),
    )


def a_guard_looks_at_no_value(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Guard, "_check_number", lambda *_: None)


def a_write_of_half_a_point_is_let_through(patch: pytest.MonkeyPatch) -> None:
    check = Guard.check

    def check_whole(guard: Guard, asked: RequestPdu, span: Span) -> None:
        if span.has(guard.place):
            check(guard, asked, span)

    patch.setattr(Guard, "check", check_whole)


def what_a_program_gives_up_is_asked_all_the_same(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(AwaitedOrigin, "wants", lambda *_: True)


def what_a_program_has_given_up_is_not_audited(patch: pytest.MonkeyPatch) -> None:
    answer = AuditedOrigin.answer

    def audit_what_is_awaited(origin: AuditedOrigin, request: Request, pdu: bytes | None) -> None:
        if not isinstance(origin.origin, AwaitedOrigin) or not origin.origin.outcome.done():
            answer(origin, request, pdu)

    patch.setattr(AuditedOrigin, "answer", audit_what_is_awaited)


def a_program_gets_what_it_got_last(patch: pytest.MonkeyPatch) -> None:
    asked, last = UnitClient._asked, dict[tuple[str, bytes], bytes]()

    async def from_last(unit: UnitClient, operator: Operator, pdu: bytes, place: Span | None = None) -> bytes:
        before = last.get((unit.name, pdu))
        last[unit.name, pdu] = await asked(unit, operator, pdu, place)
        return before or last[unit.name, pdu]

    patch.setattr(UnitClient, "_asked", from_last)


def a_reading_of_a_mirror_is_new(patch: pytest.MonkeyPatch) -> None:
    patch.setattr("gateway.library.sampled.sampled", lambda *_: ())


@pytest.mark.search
@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("world", "lie"),
    [
        ("bits", a_write_to_bits_waits_for_its_turn_between_read_and_write),
        ("bits", an_upstream_sends_others_between_read_and_write),
        ("maps", a_row_takes_what_its_neighbour_has_read),
        ("maps", half_of_a_row_is_of_the_poll_before),
        ("maps", rows_are_never_stale),
        ("maps", fresh_rows_are_filled_with_their_number),
        ("maps", a_fresh_bit_is_1_while_any_row_is_fresh),
        ("maps", a_fresh_bit_is_0_after_a_failed_poll),
        ("maps", an_age_is_that_of_any_device),
        ("maps", a_write_to_a_row_begins_where_the_row_does),
        ("maps", a_value_is_written_as_the_client_has_it),
        ("maps", a_read_does_not_wait_for_its_clients_write),
        ("maps", a_write_leaves_fresh_what_is_fresh),
        ("maps", a_row_has_what_another_one_had_before_a_reload),
        ("maps", a_swap_of_devices_leaves_their_polls),
        ("mirrors", writes_leave_a_mirror_as_it_is),
        ("mirrors", a_mirror_has_no_stale_values),
        ("monitors", writes_of_others_leave_a_mirror_as_it_is),
        ("monitors", what_is_heard_is_as_old_as_its_answer),
        ("monitors", what_was_heard_is_never_stale),
        ("moving", what_another_device_has_answered_is_shown),
        ("programs", what_a_program_gives_up_is_asked_all_the_same),
        ("programs", what_a_program_has_given_up_is_not_audited),
        ("programs", a_program_gets_what_it_got_last),
        ("programs", a_reading_of_a_mirror_is_new),
        ("reloads", a_line_that_keeps_its_name_keeps_its_devices),
        ("reloads", a_reload_keeps_what_is_shown_by_the_unit_alone),
        ("reloads", what_was_read_before_a_write_is_shown),
        ("rights", a_read_is_allowed_by_its_first_address),
        ("rights", a_reload_leaves_the_rights),
        ("rights", a_guard_looks_at_no_value),
        ("rights", a_write_of_half_a_point_is_let_through),
        ("upstreams", what_was_read_before_a_write_is_shown),
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
async def test_it_notices(world: str, lie: Lie, monkeypatch: pytest.MonkeyPatch) -> None:
    lie(monkeypatch)
    transactions = {"upstreams": 5000, "maps": 2000}.get(world, 1500)  # many servers, and many kinds of rows
    if lie is what_is_heard_is_as_old_as_its_answer:
        transactions = 8000  # it shows only where an answer came late
    assert await is_noticed(lambda seed: WORLDS[world](transactions, 0.2, seed))
