"""In which order a wall panel names what is wrong: it has room for some of it only."""

from types import SimpleNamespace

from gateway.diagnosis.finding import Finding
from gateway.lines.counts import Counts
from gateway.operator.operations.answers.trouble import Trouble, worst_first
from gateway.operator.status.troubles import troubles
from gateway.operator.status.unit_states import ShownState
from gateway.timing.history import UnitUse
from gateway.web.pages.situation import with_findings


def test_a_panel_names_what_must_be_fixed_before_what_fails_now_and_then():
    known = [
        Trouble("full", "lines", "hall"),
        Trouble("resting", "units", "axis"),
        Trouble("failing", "units", "mixer"),
        Trouble("failing", "units", "drive", found=("answers as another unit",)),
        Trouble("fix", "lines", "yard", found=("another client sends requests on this line",)),
        Trouble("down", "lines", "dock"),
    ]
    assert [each.name for each in worst_first(known)] == ["dock", "axis", "drive", "yard", "hall", "mixer"]


def test_a_lost_broker_is_a_trouble_of_its_own_and_told_once():
    def told(broker: SimpleNamespace) -> list[Trouble]:
        status = SimpleNamespace(all_lines=(), lines=(), upstreams=(), units=(), images=(), brokers=(broker,))
        finding = Finding("fix", f"broker {broker.broker}", "nothing is published: it has closed the connection")
        return with_findings(list(troubles(status, {})), SimpleNamespace(groups=[("", [finding])]))

    lost = SimpleNamespace(broker="mqtt://10.0.0.9:1883", state="down", reason="it has closed the connection")
    assert told(lost) == [Trouble("down", "", "broker mqtt://10.0.0.9:1883", reason="it has closed the connection")]
    refusing = SimpleNamespace(broker="mqtt://10.0.0.9:1883", state="up", reason="")
    assert [each.kind for each in told(refusing)] == ["fix"]


def test_how_many_requests_were_not_sent_to_a_failing_unit_is_told_with_the_usual_reason():
    unit = SimpleNamespace(name="mixer", line="hall", last_error="bad_frame", rests_ms=0.0, counts=Counts(overdue=47))
    status = SimpleNamespace(all_lines=(), lines=(), upstreams=(), units=(unit,), images=(), brokers=())
    state = ShownState("failing", UnitUse(requests=595, responses=540, failed=8, unsent=47))
    (trouble,) = troubles(status, {"mixer": state})
    assert (trouble.requests, trouble.unsent, trouble.unsent_for) == (595, 47, "overdue")
    (answered,) = troubles(status, {"mixer": ShownState("failing", UnitUse(requests=9, failed=9))})
    assert (answered.unsent, answered.unsent_for) == (0, "")
