"""The text of a scrape."""

from prometheus_client.parser import text_string_to_metric_families

from gateway.observe.families import Family, Spread
from gateway.observe.metrics import exposition


def samples(*families: Family) -> dict[tuple[str, frozenset], float]:
    text = exposition(families).decode()
    read = [sample for family in text_string_to_metric_families(text) for sample in family.samples]
    return {(sample.name, frozenset(sample.labels.items())): sample.value for sample in read}


def test_counters_end_with_total_and_gauges_do_not() -> None:
    counter = Family("counter", "retries", "Sent again.", ("line",))
    counter.add(3, "hall-a")
    gauge = Family("gauge", "line_up", "Open.", ("line",))
    gauge.add(True, "hall-a")
    labels = frozenset({("line", "hall-a")})
    assert samples(counter, gauge) == {
        ("modbus_gateway_retries_total", labels): 3,
        ("modbus_gateway_line_up", labels): 1,
    }


def test_a_histogram_has_its_buckets_count_and_sum() -> None:
    family = Family("histogram", "wait_seconds", "Waited.", ("line",))
    family.add(Spread([(0.001, 2), (10.0, 3)], 4, 12.5), "a")
    assert {(name, dict(labels).get("le")): value for (name, labels), value in samples(family).items()} == {
        ("modbus_gateway_wait_seconds_bucket", "0.001"): 2,
        ("modbus_gateway_wait_seconds_bucket", "10"): 3,
        ("modbus_gateway_wait_seconds_bucket", "+Inf"): 4,
        ("modbus_gateway_wait_seconds_count", None): 4,
        ("modbus_gateway_wait_seconds_sum", None): 12.5,
    }


def test_names_of_the_config_may_hold_anything() -> None:
    family = Family("gauge", "line_up", "Open.", ("line",))
    family.add(1, 'a"b\\c\nd')
    assert samples(family) == {("modbus_gateway_line_up", frozenset({("line", 'a"b\\c\nd')})): 1}
