"""Metrics in the text format of Prometheus.

The only module that uses prometheus-client.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector

PREFIX: Final = "modbus_gateway_"
CONTENT_TYPE: Final = CONTENT_TYPE_PLAIN_0_0_4

#: The labels of one value, in the order of its family.
Labels = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Spread:
    """A histogram: how many values did not exceed each bound, and the sum of all."""

    buckets: Sequence[tuple[float, int]]
    count: int
    total: float


@dataclass(slots=True)
class Family:
    """All values of one metric. `name` is without prefix; a counter's is without `_total` too."""

    kind: Literal["counter", "gauge", "histogram"]
    name: str
    text: str
    labels: Labels = ()
    values: list[tuple[Labels, float | Spread]] = field(default_factory=list)

    def add(self, value: float | Spread, *labels: str) -> None:
        """Add the value with these labels."""
        self.values.append((labels, value))


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
