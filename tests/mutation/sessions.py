"""The mutants of a module, and what is known of them: a session of cosmic-ray for each version of it."""

import ast
import difflib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import cosmic_ray.plugins
from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_code
from cosmic_ray.work_db import WorkDB
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkerOutcome, WorkItem, WorkResult

from mutation.operators import is_used, is_within, out_of_reach

ROOT: Final = Path(__file__).parents[2]
SESSIONS: Final = ROOT / ".mutation"


@dataclass
class Module:
    """A module of the gateway. `equivalent` are the changes that are left out, with the reason."""

    path: Path
    source: str
    database: WorkDB
    equivalent: dict[str, str]

    @property
    def name(self) -> str:
        return self.path.relative_to(ROOT).as_posix()

    @property
    def imported_as(self) -> str:
        return ".".join(self.path.relative_to(ROOT).with_suffix("").parts)

    @cached_property
    def mutants(self) -> list["Mutant"]:
        """All but the equivalent ones, in the order of the text."""
        left_out = {job for job, result in self.database.results if result.worker_outcome == WorkerOutcome.SKIPPED}
        mutants = [Mutant(self, item) for item in self.database.work_items if item.job_id not in left_out]
        return sorted(mutants, key=lambda mutant: mutant.place)

    @cached_property
    def functions(self) -> list[tuple[int, int, str]]:
        """First and last line of the body of each function that is not inside another, and its qualified name."""
        return list(_functions(ast.parse(self.source), ""))

    def reopen(self) -> None:
        """In a process of its own, the database has a connection of its own."""
        self.database = WorkDB(self.database.name(), WorkDB.Mode.open)

    @property
    def equivalents(self) -> int:
        return len(self.database.work_items) - len(self.mutants)


def _functions(within: ast.Module | ast.ClassDef, prefix: str) -> Iterator[tuple[int, int, str]]:
    for node in within.body:
        if isinstance(node, ast.ClassDef):
            yield from _functions(node, f"{prefix}{node.name}.")
        elif isinstance(node, ast.FunctionDef):
            yield node.body[0].lineno, node.end_lineno or 0, prefix + node.name


@dataclass
class Mutant:
    """One fault in one module."""

    module: Module
    item: WorkItem

    @property
    def mutation(self) -> MutationSpec:
        return self.item.mutations[0]

    @property
    def operator(self) -> str:
        return self.mutation.operator_name.partition("/")[2]

    @property
    def place(self) -> tuple[object, ...]:
        return self.mutation.start_pos, self.mutation.end_pos, self.operator, self.mutation.occurrence

    @property
    def source(self) -> str:
        """The module with the fault."""
        operator = cosmic_ray.plugins.get_operator(self.mutation.operator_name)
        return mutate_code(self.module.source, operator(), self.mutation.occurrence)

    @property
    def change(self) -> str:
        """The lines that it changes, as they were and as they are."""
        old, new = [], []
        for line in difflib.ndiff(self.module.source.splitlines(), self.source.splitlines()):
            if line.startswith("- "):
                old.append(line[2:].strip())
            elif line.startswith("+ "):
                new.append(line[2:].strip())
        return " ".join(old) + "  ->  " + " ".join(new)

    @property
    def function(self) -> str | None:
        """The function whose body it is in."""
        line = self.mutation.start_pos[0]
        return next((name for first, last, name in self.module.functions if first <= line <= last), None)

    def keep(self, *, is_killed: bool, how: str) -> None:
        outcome = TestOutcome.KILLED if is_killed else TestOutcome.SURVIVED
        result = WorkResult(WorkerOutcome.NORMAL, output=how, test_outcome=outcome, diff=self.change)
        self.module.database.set_result(self.item.job_id, result)


def open_module(path: Path, equivalent: dict[str, str], sessions: Path) -> Module:
    """What is known of a module as it is now, by the `sessions`: nothing, if it or the operators have changed."""
    source = path.read_text()
    version = hashlib.sha256(source.encode() + Path(__file__).with_name("operators.py").read_bytes()).hexdigest()[:12]
    name = path.relative_to(ROOT / "gateway").with_suffix("").as_posix().replace("/", ".")
    sessions.mkdir(parents=True, exist_ok=True)
    session = sessions / f"{name}-{version}.sqlite"
    is_new = not session.exists()
    for old in sessions.glob(f"{name}-*.sqlite"):
        if old != session:
            old.unlink()
    module = Module(path, source, WorkDB(session, WorkDB.Mode.create), equivalent)
    if is_new:
        _write_mutants(module)
    _leave_out_equivalent(module)
    return module


def _write_mutants(module: Module) -> None:
    left_out = out_of_reach(module.source)
    everything = WorkDB(":memory:", WorkDB.Mode.create)
    init([module.path], everything, {})
    module.database.add_work_items(
        item
        for item in everything.work_items
        if is_used(item.mutations[0].operator_name)
        and not is_within((item.mutations[0].start_pos, item.mutations[0].end_pos), left_out)
    )
    everything.close()


def _leave_out_equivalent(module: Module) -> None:
    seen = set()
    left_out = "\n".join(module.equivalent)
    lines = module.source.splitlines()
    for item in module.database.work_items if module.equivalent else ():
        first, last = item.mutations[0].start_pos[0] - 2, item.mutations[0].end_pos[0]
        if not any(line.strip() in left_out for line in lines[max(0, first) : last] if line.strip()):
            continue  # to make a mutant takes long
        change = Mutant(module, item).change
        if change in module.equivalent:
            seen.add(change)
            result = WorkResult(WorkerOutcome.SKIPPED, output=module.equivalent[change])
            module.database.set_result(item.job_id, result)
    for change in module.equivalent.keys() - seen:
        print(f"{module.name} has no mutant {change!r}")
