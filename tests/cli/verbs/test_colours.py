"""What commands show in red and in yellow."""

import pytest

from gateway.cli.kit.paint import badness
from gateway.cli.show.trace_rows import TraceRow
from gateway.cli.verbs import doctor, ports, scan
from gateway.diagnosis.finding import Finding
from gateway.hardware.listing import ListedPort
from gateway.operator.operations.answers.scan import Found

FINE, DOUBTFUL, BROKEN = 0, 1, 2


@pytest.mark.parametrize(("level", "shown"), [("ok", FINE), ("note", DOUBTFUL), ("fix", BROKEN)])
def test_doctor(level, shown) -> None:
    assert badness(doctor.table([Finding(level, "plc", "a fix, or a note", "a remedy")], 80)) == shown


@pytest.mark.parametrize(
    ("way", "unit", "text", "shown"),
    [
        (">", "1", "read holding 0", FINE),
        ("<", "1", "17820", FINE),
        ("<", "1", "exception 02, illegal data address", DOUBTFUL),
        ("<", "?", "3 bytes of noise: 00", DOUBTFUL),
        ("-", "1", "timeout", BROKEN),
        ("x", "1", "read holding 0 not sent", BROKEN),
        ("!", "", "port lost: unplugged", BROKEN),
        ("!", "", "port open", FINE),
    ],
)
def test_trace(way, unit, text, shown) -> None:
    assert badness(TraceRow(0.0, "hall", way, unit, text).show((4, 3))) == shown


@pytest.mark.parametrize(
    ("result", "code", "shown"), [("answers", None, FINE), ("exception", 2, DOUBTFUL), ("garbled", None, BROKEN)]
)
def test_scan(result, code, shown) -> None:
    found = Found(unit=1, result=result, code=code, answer_ms=1.0, profile="", answers_from=None, models=(), baud=9600)
    assert badness(" ".join(scan._cells(found, several_rates=False))) == shown


@pytest.mark.parametrize(("state", "shown"), [("free", FINE), ("in use", FINE), ("no permission", BROKEN)])
def test_ports(state, shown) -> None:
    assert badness(" ".join(ports._row(ListedPort("/dev/x", "/dev/x", "adapter", "ftdi", state, "by 1")))) == shown
