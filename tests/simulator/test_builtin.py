import subprocess
import sys
from dataclasses import replace

import pytest

from gateway.config.plan.profiles import profile_of
from gateway.config.reading.profile_file import shipped_profile
from gateway.simulator.builtin import builtin_profile


@pytest.mark.parametrize("name", ["generic", "mint", "v80", "weigher"])
def test_a_profile_is_what_a_config_makes_of_it(name: str) -> None:
    """But for what follows from its points: a simulator reads none."""
    made = profile_of(name, shipped_profile(name).table)
    assert builtin_profile(name) == replace(made, only_written=())


def test_a_simulator_starts_without_what_checks_a_config() -> None:
    found = "import gateway.cli.verbs.simulate, sys; print('pydantic' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", found], capture_output=True, text=True, check=True)
    assert shown.stdout == "False\n"
