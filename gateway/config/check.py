"""What must fit together in a config."""

from collections.abc import Callable, Iterator

from gateway.config.problem import Problem
from gateway.config.schema import Config


def check(
    config: Config, port_exists: Callable[[str], bool], real_path: Callable[[str], str], failed: frozenset[str]
) -> Iterator[Problem]:
    """."""
    return iter(())
