"""Metrics in the text format of Prometheus.

The only module that uses prometheus-client.
"""

from collections.abc import Iterable, Iterator
from typing import Final

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector

from gateway.observe.families import Family, Spread

PREFIX: Final = "modbus_gateway_"
CONTENT_TYPE: Final = CONTENT_TYPE_PLAIN_0_0_4


def exposition(families: Iterable[Family]) -> bytes:
    """Make the text for a scrape. Takes a millisecond for some hundred values."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Given(families))
    return generate_latest(registry)


class _Given(Collector):
    """A collector of values that were read before."""

    def __init__(self, families: Iterable[Family]) -> None:
        self._families = families

    def collect(self) -> Iterator[Metric]:
        """Yield the metrics of the families."""
        for family in self._families:
            yield _metric(family)

    def describe(self) -> Iterable[Metric]:
        """Return nothing: the families are known only with their values."""
        return ()


def _metric(family: Family) -> Metric:
    name = PREFIX + family.name
    if family.kind == "histogram":
        histogram = HistogramMetricFamily(name, family.text, labels=family.labels)
        for labels, value in family.values:
            if isinstance(value, Spread):
                buckets = [(f"{bound:g}", float(count)) for bound, count in value.buckets]
                histogram.add_metric(labels, [*buckets, ("+Inf", float(value.count))], value.total)
        return histogram
    plain = (CounterMetricFamily if family.kind == "counter" else GaugeMetricFamily)(
        name, family.text, labels=family.labels
    )
    for labels, value in family.values:
        if not isinstance(value, Spread):
            plain.add_metric(labels, value)
    return plain
