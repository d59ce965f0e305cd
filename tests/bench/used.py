"""What processes have used, and who goes first."""

import os
from collections.abc import Iterable
from pathlib import Path


def cpu(pid: int, *, with_children: bool = False) -> float:
    """The seconds of CPU time that a process has used, or that and what its ended children have."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11 : 15 if with_children else 13])) / os.sysconf("SC_CLK_TCK")


def resident(pid: int) -> int:
    """Resident memory in KiB."""
    return int(Path(f"/proc/{pid}/status").read_text().split("VmRSS:")[1].split()[0])


def go_first(pids: Iterable[int]) -> None:
    """Let all threads of these go before those of others. That needs root."""
    for pid in pids:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_RR, os.sched_param(5))
