"""Nothing measured is lost on its way to the plant: gateway and broker are killed, stopped and away, again and again.

    .venv/bin/python tests/soak/kept.py --rounds 500
    .venv/bin/python tests/soak/kept.py --rounds 500 --form sparkplug

A gateway with `keep` reads devices that know what they have answered, and publishes to mosquitto. Each round has one
fault, or two at once. A subscriber is there whenever the broker is; what it has heard is compared with what the devices
have answered: see kept_judge. Only what was answered less than `keep_every` before a `kill -9` of the gateway may be
missing, and a second more, as the disk takes its time. The gateway connects again after a second at most here, not
after 30.

`--clock` sets the wall clock of the gateway in between, `--disk` fills its disk. `--lie` breaks the gateway on purpose:
the judge must notice.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from kit import process
from soak.kept_judge import Problem, count, judge
from soak.kept_stage import LIES, PLAIN, PROGRAM, SPARKPLUG, Stage
from soak.kept_world import Loop
from soak.standby import wall_clock

#: Between so many rounds everything is sent, and judged.
CHAPTER = 20
#: So many problems are told with what happened around them, and what was heard so many seconds around the first one.
MOST_TOLD, WORTH_TELLING = 20, 4.0


def soak(rounds: int, stage: Stage, only: str = "") -> list[Problem]:
    """So many faults; all problems."""
    problems: list[Problem] = []
    left: list[Problem] = []
    begun = time.monotonic()
    with stage.running():
        for number in range(1, rounds + 1):
            kinds = [kind for kind in stage.kinds if only in kind]
            stage.round(stage.choose.choice(kinds))
            if number % CHAPTER == 0 or number == rounds:
                stage.wait_until_sent()
                kept = stage.kept_in_the_end
                if kept and kept["values"]:
                    left.append(Problem("still kept", time.time(), f"all of it {kept}"))
                known, problems = {*problems}, judge(stage.record()) + left
                tell(stage, [each for each in problems if each not in known])
                took = time.monotonic() - begun
                print(f"{number} rounds, {took:.0f} s, kept: {kept}: {count(problems) or 'no problem'}", flush=True)
    return problems


def tell(stage: Stage, problems: list[Problem]) -> None:
    """Print problems, and what happened around them."""
    for problem in problems[:MOST_TOLD]:
        around = [
            f"{scene.text} ({scene.begun - problem.at:+.2f} to {scene.ended - problem.at:+.2f} s)"
            for scene in stage.story
            if scene.begun - 3 < problem.at < scene.ended + 12
        ]
        print(f"{problem.kind}: {problem.text}\n    {'; '.join(around)}", flush=True)
    for problem in problems[:1]:
        device, record = problem.text.split()[0], stage.record()
        for told in record.heard:
            if told.device == device and abs(told.at - problem.at) < WORTH_TELLING:
                entries = [(round(entry.at - problem.at, 3), *entry.values.items()) for entry in told.entries]
                print(f"  {told.at - problem.at:+.3f} s {'history' if told.is_history else 'live'}: {entries}")
    if problems:
        stage.tell()


@contextmanager
def small_disk(at: Path) -> Iterator[Path]:
    """A disk of its own, in memory."""
    at.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2M", "tmpfs", at], check=True)
    try:
        yield at
    finally:
        subprocess.run(["umount", "--lazy", at], check=True)


def figures(stage: Stage) -> str:
    """What was told, in words."""
    record = stage.record()
    history = [told for told in record.heard if told.is_history]
    values = sum(len(entry.values) for told in history for entry in told.entries)
    answered = sum(len(answer.values) for answer in record.answers)
    came = f"{len(record.heard) - len(history)} live messages came, and {len(history)} of history with {values} values"
    return f"{answered} values were answered; {came}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--form", choices=(PLAIN, SPARKPLUG), default=PLAIN)
    parser.add_argument("--clock", action="store_true", help="the gateway's wall clock is set in between")
    parser.add_argument("--disk", action="store_true", help="its disk is full now and then; needs root")
    parser.add_argument("--no-keep", action="store_true", help="the gateway keeps nothing: values must be missing")
    parser.add_argument("--lie", choices=LIES, default="", help="break the gateway")
    parser.add_argument("--only", default="", help="only faults with these words")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that nothing is left behind
    process.COMMAND[:] = [sys.executable, "-P", "-c", PROGRAM.format(lie=LIES[arguments.lie])]
    with tempfile.TemporaryDirectory() as name, Loop() as loop, ExitStack() as stack:
        folder = Path(name)
        clock = wall_clock(folder) if arguments.clock else None
        disk = stack.enter_context(small_disk(folder / "disk")) if arguments.disk else None
        stage = Stage(folder, loop, arguments.seed, arguments.form, keep=not arguments.no_keep, clock=clock, disk=disk)
        problems = soak(arguments.rounds, stage, arguments.only)
        for kind, times in sorted(stage.faults.items()):
            print(f"{times:4} times: {kind}")
        print(figures(stage))
        print(f"{arguments.rounds} rounds: {count(problems) or 'no problem'}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
