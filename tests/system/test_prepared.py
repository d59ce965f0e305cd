"""Processes of the gateway that are forked off: kit/prepared.py."""

import os
import select
import signal

from kit.prepared import Preparation
from kit.process import PATIENCE


def test_what_a_killed_test_run_has_started_ends(tmp_path):
    config = tmp_path / "gateway.toml"
    config.write_text('[[image]]\nunit = 1\nholding = 1\n[[listen]]\nbind = "tcp://127.0.0.1:0"\n')
    said, its_output = os.pipe()
    own = {**os.environ, "STATE_DIRECTORY": str(tmp_path), "RUNTIME_DIRECTORY": str(tmp_path)}
    with os.fdopen(said) as log:
        with Preparation(f"for {tmp_path}") as preparation:
            process = preparation.start(["run", str(config)], own, stderr=its_output)
            os.close(its_output)
            assert any("ready" in line for line in log)
            ends = os.pidfd_open(process.pid)
        has_ended = select.select([ends], [], [], PATIENCE)[0]
        os.close(ends)
        if not has_ended:
            os.kill(process.pid, signal.SIGKILL)
        assert has_ended
