"""What doctor finds on a line where the gateway only listens, and that it blames nobody for what it cannot know."""

import pytest

from gateway.diagnosis.evidence import HeardUnitEvidence, LineEvidence, MonitorEvidence, PolledEvidence, SourceEvidence
from gateway.diagnosis.images import about_polled
from gateway.diagnosis.monitors import about_monitor
from gateway.ports.port import CharacterErrors

BOILER = HeardUnitEvidence("boiler", 3, 500, 498)
PUMP = HeardUnitEvidence("pump", 4, 500, 500)


def port(**others):
    return LineEvidence("old-plc", "gateway.toml:5", 9600, "8N1", **others)


def line(on_port=None, **others):
    usual = {"requests": 1000, "answers": 998, "sure": 990, "ago": 0.2, "units": (BOILER, PUMP)}
    return MonitorEvidence("old-plc", "rtu", on_port or port(), **(usual | others))


SILENT = {"requests": 0, "answers": 0, "sure": 0, "ago": None}


def found(evidence):
    return [(each.level, each.what) for each in about_monitor(evidence)]


def remedies(evidence):
    return " ".join(each.remedy for each in about_monitor(evidence))


def test_a_line_that_is_heard_well():
    assert found(line()) == [("ok", "1000 requests heard, 998 with an answer, values of 990 taken")]


def test_a_line_that_is_down():
    down = line(port(reason="/dev/plc does not exist"), **SILENT)
    assert found(down) == [("fix", "is down: /dev/plc does not exist")]


def test_a_line_on_which_nothing_is_heard():
    assert found(line(**SILENT)) == [("fix", "nothing has been heard yet")]
    assert "A and B swapped" in remedies(line(**SILENT))


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
@pytest.mark.parametrize("evidence", [{"noise": 40}, {"on_port": port(errors=CharacterErrors(300, 0, 0, 0))}])
def test_a_wrong_rate_or_mode(mode, evidence):
    usual = {"on_port": port(), **SILENT, **evidence}
    heard = MonitorEvidence("old-plc", mode, **usual)
    assert found(heard) == [("fix", f"what is heard is no Modbus at 9600 8N1, {mode.upper()}")]
    assert f'mode = "{"ascii" if mode == "rtu" else "rtu"}"' in remedies(heard)


def test_a_wrong_parity_is_told_beside():
    errors = CharacterErrors(300, 0, 150, 0)
    levels = [level for level, what in found(line(port(errors=errors), **SILENT, noise=40))]
    assert levels == ["fix", "fix"]


def test_a_receiver_that_hears_the_devices_only():
    assert found(line(**SILENT, strays=12)) == [("fix", "12 responses were heard, and no request")]


def test_a_receiver_that_hears_the_client_only():
    alone = line(answers=0, sure=0, units=(HeardUnitEvidence("boiler", 3, 1000, 0),))
    assert ("fix", "1000 requests heard, and no response") in found(alone)
    assert "one direction only" in remedies(alone)


def test_a_client_that_only_broadcasts_is_no_fault():
    assert all(level != "fix" for level, _ in found(line(answers=0, sure=0, asks_units=False)))


def test_a_device_that_nobody_asks():
    unheard = line(units=(BOILER, HeardUnitEvidence("mixer", 7, 0, 0)))
    assert ("note", "nobody has asked mixer (unit 7) yet") in found(unheard)


def test_units_that_are_asked_and_not_configured():
    others = line(unknown_units=((9, 300), (12, 1)))
    expected = "units are asked that are not configured: 9 (300 requests), 12 (1 request)"
    assert ("note", expected) in found(others)


def test_a_unit_without_answers_is_a_note_and_never_to_fix():
    deaf = line(units=(BOILER, HeardUnitEvidence("pump", 4, 500, 350)))
    assert ("note", "150 of 500 requests of others had no answer that was heard") in found(deaf)
    assert all(level != "fix" for level, _ in found(deaf))


def test_answers_of_which_few_can_be_believed():
    assert ("note", "of 998 answers, 300 have values that are sure") in found(line(sure=300))


def test_noise_between_frames():
    assert ("note", "200 stretches of bytes between 1000 requests were no frames") in found(line(noise=200))


def test_a_bus_that_has_fallen_silent():
    (note,) = found(line(ago=3600.0))
    assert note[0] == "note"
    assert note[1].endswith("; the last one 60 min ago")


@pytest.mark.parametrize("ago", [None, 3600.0])
def test_a_mirror_without_values_leads_to_what_others_read(ago):
    source = SourceEvidence("boiler", "old-plc", ago, is_lost=ago is None, is_heard=True)
    (finding,) = about_polled(PolledEvidence("copy", "mirror copy", 2.0, (source,)))
    assert finding.remedy.startswith("modbus-gateway trace old-plc shows what others read of it")
