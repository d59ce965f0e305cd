"""Runs the tests of a mutant in a child process, where possible in one in which all tests are collected already.

A fault in the body of a function replaces the code of that function. Any other fault, and one in a function that was
called while the tests were collected, needs a process that imports everything anew.
"""

import importlib.machinery
import importlib.util
import json
import os
import resource
import signal
import sys
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import monotonic, process_time
from typing import Final

import hypothesis
import pytest

from mutation.sessions import Module, Mutant

#: Tests of other packages that see more of a package than its own do.
WIDER: Final = {"modbus": ("lines",), "timing": ("lines",)}
TESTS: Final = ("tests/lines", "tests/modbus", "tests/routing", "tests/timing", "tests/stories/lines")

#: Processor time of a test of a mutant, as a multiple of that without it, and in seconds; what takes longer is killed.
PATIENCE: Final = 5.0
SECONDS: Final = 1.0
#: Seconds on the clock for all tests of a mutant. Behind that nothing is known of it: the machine may be busy.
LONGEST: Final = 600
_OUT_OF_TIME: Final = f"signal {signal.SIGKILL:d}"
#: Memory of a mutant, in bytes.
MEMORY: Final = 3 * 2**30

_PYTEST: Final = (
    *("-x", "-q", "--no-header", "--tb=no", "--capture=no", "--timeout=0", "--hypothesis-profile=mutants"),
    *(
        "-W",
        "ignore::pytest.PytestAssertRewriteWarning",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-p",
        "no:pytest_cov",
    ),
)
hypothesis.settings.register_profile(
    "mutants", deadline=None, derandomize=True, phases=[hypothesis.Phase.explicit, hypothesis.Phase.generate]
)


@dataclass
class Survey:
    """What was seen without any mutant. Tests by their identifiers, with processor time in seconds."""

    tests: dict[str, float] = field(default_factory=dict)
    #: Module and function of what was called while they were collected.
    called: list[str] = field(default_factory=list)


class _Surveyor:
    """A plugin that sees how long each test takes, and what is called before the first."""

    def __init__(self) -> None:
        self.survey = Survey()
        self._called: set[str] = set()
        sys.setprofile(self._look)

    def _look(self, frame: types.FrameType, event: str, _: object) -> None:
        if event == "call" and (name := frame.f_globals.get("__name__", "")).startswith("gateway."):
            self._called.add(f"{name}:{frame.f_code.co_qualname}")

    def pytest_collection_finish(self) -> None:
        sys.setprofile(None)
        self.survey.called = sorted(self._called)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        begin = process_time()
        result = yield
        self.survey.tests[item.nodeid] = process_time() - begin
        return result


def survey(file: Path, tests: Sequence[str]) -> Survey | None:
    """Run the tests without any mutant, or read from `file` what came out of that. None if they fail."""
    if not file.exists() and _wait(_fork(lambda: _write_survey(file, tests))) != 0:
        return None
    return Survey(**json.loads(file.read_text()))


def _write_survey(file: Path, tests: Sequence[str]) -> int:
    _discard((1,))
    surveyor = _Surveyor()
    status = int(pytest.main([*_PYTEST, *tests], plugins=[surveyor]))
    if status == 0:
        for old in file.parent.glob("tests-*.json"):
            old.unlink()
        file.write_text(json.dumps(asdict(surveyor.survey)))
    return status


def _fork(run: Callable[[], int], *, quiet: bool = False) -> int:
    """A child that ends with what `run` returns."""
    child = os.fork()
    if child:
        return child
    status = 70
    try:
        if quiet:
            _be_quiet()
        status = run()
    finally:
        sys.stdout.flush()
        os._exit(status)


def _be_quiet() -> None:
    os.setpgid(0, 0)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    _discard((0, 1, 2))


def _discard(descriptors: Iterable[int]) -> None:
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in descriptors:
        os.dup2(nothing, descriptor)


def _wait(child: int) -> int:
    return os.waitpid(child, 0)[1]


class Selection:
    """A plugin that runs the tests of a module: the nearest first, then the quickest, each with a limit.

    With `everything` it runs all tests that were collected.
    """

    def __init__(self, module: Module, seen: Survey, longest: float, *, everything: bool) -> None:
        self._package, self._stem = module.path.parent.name, module.path.stem
        self._times = seen.tests
        self._longest = longest
        self._everything = everything

    def select(self, items: list[pytest.Item]) -> None:
        chosen = [item for item in items if self._rank(item) < 3 and self._time(item) <= self._longest]
        items[:] = sorted(chosen, key=lambda item: (self._rank(item), self._time(item)))

    def _rank(self, item: pytest.Item) -> int:
        if self._everything:
            return 0
        folder = item.path.parent.name
        if folder == self._package:
            return 0 if item.path.stem.startswith(f"test_{self._stem}") else 1
        return 2 if folder in WIDER.get(self._package, ()) else 3

    def _time(self, item: pytest.Item) -> float:
        return self._times.get(item.nodeid, 0.0)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        self.select(items)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        signal.setitimer(signal.ITIMER_PROF, SECONDS + PATIENCE * self._time(item))  # its signal ends the process
        result = yield
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        return result


class Runner:
    """Runs mutants, so many at once. Tests that take more than `longest` seconds are left out.

    With `only`, these tests run for each mutant, in place of those of its package.
    """

    def __init__(self, seen: Survey, jobs: int, longest: float, only: Sequence[str]) -> None:
        self._seen = seen
        self._only = only
        self._jobs = jobs
        self._longest = longest
        self._called = set(seen.called)
        self._done = 0
        self._begin = monotonic()

    def run(self, mutants: Sequence[Mutant]) -> None:
        """Run them, those first that need no new imports, and keep what comes out in their sessions."""
        self._inside = [mutant for mutant in mutants if self._fits_inside(mutant)]
        if self._inside:
            _wait(_fork(self._serve))
        self._all(mutant for mutant in mutants if not self._fits_inside(mutant))

    def _serve(self) -> int:
        """Collect all tests. Each mutant then runs in a child."""
        for module in {id(mutant.module): mutant.module for mutant in self._inside}.values():
            module.reopen()
        _discard((1,))
        return int(pytest.main([*_PYTEST, *(self._only or TESTS)], plugins=[self]))

    def _fits_inside(self, mutant: Mutant) -> bool:
        function = mutant.function
        return function is not None and f"{mutant.module.imported_as}:{function}" not in self._called

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        running = _Children(self._jobs)
        for mutant in self._inside:
            running.make_room(self._end)
            child = os.fork()
            if not child:
                return self._go_inside(mutant, session)
            running.add(child, mutant)
        running.end(self._end)
        return True

    def _go_inside(self, mutant: Mutant, session: pytest.Session) -> None:
        _be_quiet()
        selection = self._selection(mutant.module)
        selection.select(session.items)
        session.config.pluginmanager.register(selection)
        try:
            replace(mutant)
        except LookupError:  # no test imports its module, so none can kill it
            session.items.clear()

    def _all(self, mutants: Iterable[Mutant]) -> None:
        running = _Children(self._jobs)
        for mutant in mutants:
            running.make_room(self._end)
            running.add(_fork(lambda mutant=mutant: self._anew(mutant), quiet=True), mutant)
        running.end(self._end)

    def _anew(self, mutant: Mutant) -> int:
        """The nearest tests first, as it takes a while to collect all."""
        sys.meta_path.insert(0, _Mutated(mutant))
        selection = self._selection(mutant.module)
        if self._only:
            return int(pytest.main([*_PYTEST, *self._only], plugins=[selection]))
        package = mutant.module.path.parent.name
        folders = [folder for folder in TESTS if Path(folder).name in {package, *WIDER.get(package, ())}]
        nearest = sorted(str(file) for file in Path("tests", package).glob(f"test_{mutant.module.path.stem}*.py"))
        status = int(pytest.main([*_PYTEST, *nearest], plugins=[selection])) if nearest else 0
        if status in {0, int(pytest.ExitCode.NO_TESTS_COLLECTED)}:
            status = _wait(_fork(lambda: int(pytest.main([*_PYTEST, *folders], plugins=[selection]))))
            return 1 if status else 0
        return status

    def _selection(self, module: Module) -> Selection:
        return Selection(module, self._seen, self._longest, everything=bool(self._only))

    def _end(self, mutant: Mutant, status: int) -> None:
        how = f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else f"status {os.WEXITSTATUS(status)}"
        if how == _OUT_OF_TIME:
            print(f"  undecided after {LONGEST} s: {mutant.module.name}: {mutant.change}", file=sys.stderr, flush=True)
        else:
            mutant.keep(is_killed=status != 0, how=how)
        self._done += 1
        if self._done % 100 == 0:
            print(f"  {self._done} mutants in {monotonic() - self._begin:.0f} s", file=sys.stderr, flush=True)


class _Children:
    """Processes that run now, each with its mutant and the time on the clock at which it is ended."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._running: dict[int, tuple[Mutant, float]] = {}

    def add(self, child: int, mutant: Mutant) -> None:
        self._running[child] = mutant, monotonic() + LONGEST

    def make_room(self, end: Callable[[Mutant, int], None]) -> None:
        while len(self._running) >= self._most:
            child, status = self._next()
            end(self._running.pop(child)[0], status)

    def end(self, end: Callable[[Mutant, int], None]) -> None:
        self._most = 1
        self.make_room(end)

    def _next(self) -> tuple[int, int]:
        signal.signal(signal.SIGALRM, _raise_timeout)
        while True:
            first = min(at for _, at in self._running.values())
            signal.alarm(max(1, int(first - monotonic())))
            with suppress(TimeoutError):
                child, status = os.wait()
                signal.alarm(0)
                return child, status
            for child, (_, at) in self._running.items():
                if monotonic() >= at - 1:
                    os.killpg(child, signal.SIGKILL)


def _raise_timeout(*_: object) -> None:
    raise TimeoutError


class _Mutated(importlib.machinery.SourceFileLoader):
    """Finds and loads one module, with its fault."""

    def __init__(self, mutant: Mutant) -> None:
        super().__init__(mutant.module.imported_as, str(mutant.module.path))
        self._source = mutant.source

    def get_code(self, fullname: str) -> types.CodeType:
        return compile(self._source, self.path, "exec", dont_inherit=True)

    def find_spec(self, name: str, path: object = None, target: object = None) -> importlib.machinery.ModuleSpec | None:
        return importlib.util.spec_from_file_location(name, self.path, loader=self) if name == self.name else None


def replace(mutant: Mutant) -> None:
    """Put a fault into the function that has been imported without it."""
    codes = _codes(compile(mutant.source, str(mutant.module.path), "exec", dont_inherit=True))
    found = [code for code in codes if code.co_qualname == mutant.function]
    live = [
        function
        for function in _live(vars(sys.modules[mutant.module.imported_as]))
        if function.__code__.co_qualname == mutant.function and function.__module__ == mutant.module.imported_as
    ]
    if len(found) != 1 or not live:
        raise LookupError(mutant.function)
    for function in live:
        function.__code__ = found[0]


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield constant
            yield from _codes(constant)


def _live(names: dict[str, object]) -> Iterator[types.FunctionType]:
    for value in names.values():
        for each in (value, getattr(value, "__func__", None), getattr(value, "__wrapped__", None), *_accessors(value)):
            if isinstance(each, types.FunctionType):
                yield each
        if isinstance(value, type) and value.__module__.startswith("gateway."):
            yield from _live(dict(vars(value)))


def _accessors(value: object) -> tuple[object, ...]:
    return (value.fget, value.fset) if isinstance(value, property) else (getattr(value, "func", None),)
