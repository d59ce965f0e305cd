"""What is kept of the bytes of one request is bounded; what is made of them stands in tests/stories/lines."""

import pytest

from kit.line_bench import Bench


@pytest.mark.parametrize("virtual", [True, False], ids=["response", "before the request has left"])
def test_babble_is_kept_up_to_a_bound(virtual: bool) -> None:
    bench = Bench(virtual=virtual)
    bench.ask()
    for _ in range(100):
        bench.hear("55" * 100)
    assert len(bench.line._receiver._text) <= 1024 + 100
