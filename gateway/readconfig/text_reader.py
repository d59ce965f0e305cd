"""Checks a text in this process, which is one of its own. See text_check."""

import os
import resource
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from os.path import normpath
from pathlib import Path
from typing import Final

from gateway.config.load import Loaded, parse
from gateway.config.plan.differences import differences, need_restart
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, dotted
from gateway.config.reading.masking import difference, shown
from gateway.config.reading.whole_text import parted
from gateway.readconfig.text_check import TextChanges, TextCheck, TextProblem, unpacked_texts

#: What checking a text may take of memory, in bytes: the service has 512 MiB for all. 10 000 rows need a third of it.
MOST_MEMORY: Final = 256 * 1024 * 1024
#: So much lower is its priority than that of the gateway. At the least one it would not end while others are busy.
_NICE: Final = 10
#: The most characters of what a problem says: it may quote the text.
_MOST_SAID: Final = 400

_NOT_LOOKED_AT: Final = (
    "not looked at: ports, addresses of this machine, certificates, users, and other files that it names"
)


def check_given_text(file: Path, given: bytes) -> TextCheck:
    """Check a text in this process, which is limited from now on. `given` are that text and the one in use, packed."""
    with suppress(OSError):  # a service whose unit forbids it, as those before this one did
        os.nice(_NICE)
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_MEMORY, MOST_MEMORY))
    text, in_use = unpacked_texts(given)
    try:
        return look_at(text, in_use, file)
    except MemoryError:
        sys.exit(f"it needs more than {MOST_MEMORY >> 20} MiB of memory")


def look_at(text: str, in_use: str, file: Path) -> TextCheck:
    """Check `text` as the content of `file`, compare it with the text `in_use`, and open nothing that they name."""
    _, included = parted(text)
    if not included:  # as the page that adds a line has them
        in_use, _ = parted(in_use)
    loaded = _parse(text, file)
    notes = [_NOT_LOOKED_AT, *_about_included(loaded, included), *_about_profiles(loaded), *_about_python(loaded)]
    changes = None
    if loaded.plan is not None:
        before = _parse(in_use, file)
        if before.plan is None:
            notes.append("what it would change is not known: the config in use cannot be read again")
        else:
            changes = _changes(before.plan, loaded.plan)
    return TextCheck(
        problems=tuple(_told(each, file) for each in loaded.problems),
        changes=changes,
        difference=difference(shown(in_use), shown(text), "in use", "this text"),
        notes=tuple(notes),
    )


def _parse(text: str, file: Path) -> Loaded:
    """Parse a text as the content of `file`: own profiles are where that one finds them."""
    return parse(text, str(file), port_trouble=lambda _: None, real_path=normpath)


def _changes(old: Plan, new: Plan) -> TextChanges:
    found = differences(old, new)
    return TextChanges(found.added, found.removed, found.changed, need_restart(old, new))


def _about_included(loaded: Loaded, included: Mapping[str, str]) -> Iterator[str]:
    names = ", ".join(loaded.planning.config.include) if loaded.planning is not None and not included else ""
    if names:
        yield f"include is not followed: {names}"


def _about_profiles(loaded: Loaded) -> Iterator[str]:
    names = ", ".join(loaded.profile_texts)
    if names:
        yield f"own profiles are those of the gateway: {names}"


def _about_python(loaded: Loaded) -> Iterator[str]:
    images = () if loaded.config is None else loaded.config.image
    names = ", ".join(image.python for image in images if image.python is not None)
    if names:
        yield f"not imported: {names}"


def _told(problem: Problem, file: Path) -> TextProblem:
    name = f' ({problem.path[0]} "{problem.name}")' if problem.name else ""
    return TextProblem(
        problem.severity,
        problem.line,
        problem.column,
        _cut(dotted(problem.path[:_MOST_SAID])),
        _cut(problem.what + name),
        _cut(problem.remedy),
        "" if problem.file == str(file) else problem.file,
    )


def _cut(text: str) -> str:
    return text if len(text) <= _MOST_SAID else f"{text[:_MOST_SAID]}..."
