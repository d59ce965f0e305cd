"""The question of a scan waits for a line's idle time, and nobody waits for more than one of them."""

import pytest

from gateway.devices.device import ScannedUnit
from gateway.lines.idle import OTHERS
from gateway.lines.transaction import ScanTransaction
from gateway.modbus.pdu import parse_request
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from kit.asker import Asker
from kit.line_bench import LIMIT, REQUEST_TIME, Bench

QUESTION = "03 00 00 00 01"
ANSWER_TIME = AnswerTime(TimingTable(), margin=1.0, timeout=0.2)


class Scanning(Bench):
    """A line, and somebody who scans it."""

    def scan(self, unit: int) -> None:
        request = Asker("control").ask(QUESTION, unit=unit, now=self.now)
        asked = ScannedUnit(unit, ANSWER_TIME, lambda: self.now)
        question = ScanTransaction(request, parse_request(request.pdu), asked, awaits_second=True, patience=0.0)
        self.line.submit(question, self.now)


@pytest.mark.parametrize("count", [3, 40])
def test_on_a_line_that_is_never_free_it_has_its_turn_and_nobody_waits_for_two(count: int) -> None:
    """Clients ask again as soon as they have a response; a scan does the same."""
    bench = Scanning()
    clients = {unit: Asker(f"10.0.0.{unit}:1") for unit in range(1, count + 1)}
    for unit, client in clients.items():
        bench.ask(unit=unit, client=client)
    scanned, sent, worst = 100, 0, 0
    waited = dict.fromkeys(clients, 0)
    bench.scan(unit=scanned)
    while scanned < 110:
        bench.pass_time(0.01)
        assert sent < len(bench.written)
        unit, sent = int(bench.written[sent][:2], 16), sent + 1
        if unit in clients:
            worst = max(worst, waited[unit])
            waited[unit] = 0
            bench.respond(unit=unit)
            bench.ask(unit=unit, client=clients[unit])
        else:
            waited = {each: scans + 1 for each, scans in waited.items()}
            scanned += 1
            bench.pass_time(REQUEST_TIME + LIMIT - 0.01)
            bench.scan(unit=scanned)
    assert worst == 1
    assert min(len(client.answers) for client in clients.values()) >= 9 * OTHERS // count - 3
