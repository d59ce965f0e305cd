"""Makes the API page of the docstrings of what `gateway` and `gateway.events` export.

In a docstring, what stands in single backticks and begins as a class does is a reference. The site is not made if one
leads nowhere, or if a signature has a type that is neither public nor Python's own.
"""

import builtins
import re
import sys
from collections.abc import Iterator
from enum import EnumType
from inspect import get_annotations
from typing import Any

from docutils.nodes import Element
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.typing import stringify_annotation

from gateway.events import Event

_IN_BACKTICKS = re.compile(r"(?<![`:])`([^`]+)`(?!`)")
_RAISES = re.compile(r"^    (\w+(?:, \w+)*):(?= )")
_CLASS = re.compile(r"[A-Z][a-z]\w*(\.\w+)?")
#: What an event has for the parts of the gateway.
_OF_PARTS = frozenset({"says", "begins", "ends", "of", "field_names", "name"})


def write_docstring(_app: Sphinx, _what: str, _name: str, found: Any, _options: Any, lines: list[str]) -> None:
    """Write references and code as Sphinx needs them, and what an event says."""
    written: list[str] = []
    for line in lines:
        if line.startswith("    ") and written[-1:] == [""]:
            written += [".. code-block:: python", ""]
        written.append(_IN_BACKTICKS.sub(_referred, _RAISES.sub(r":raises \1:", line)))
    written = [line for line in written if line != "Raises:"]
    if _is_event(found) and found.says:
        written += ["", f"{found.level.name} ``{found.name}``: {found.says}"]
    lines[:] = written


def _referred(name: re.Match[str]) -> str:
    return f":py:obj:`{name[1]}`" if _CLASS.fullmatch(name[1]) else f"``{name[1].strip()}``"


def write_signature(
    _app: Sphinx, _what: str, _name: str, found: Any, _options: Any, signature: str | None, returns: str
) -> tuple[str | None, str]:
    """Show the fields of an event; and no constructor that is not for programs."""
    if _is_event(found):
        return f"({', '.join(_fields(found))})", ""
    if isinstance(found, EnumType) or "<factory>" in (signature or ""):
        return "", ""
    is_for_parts = isinstance(found, type) and (found.__init__.__doc__ or "").startswith("Use ")
    return ("", "") if is_for_parts else (signature, returns)


def _fields(event: type[Event]) -> Iterator[str]:
    types = get_annotations(event)
    for name in event.field_names:
        default = f" = {getattr(event, name)!r}" if hasattr(event, name) else ""
        yield f"{name}: {stringify_annotation(types[name], 'smart')}{default}"


def leave_out(_app: Sphinx, _what: str, name: str, _found: Any, is_left_out: bool, _options: Any) -> bool:  # noqa: FBT001
    """Leave out what an event has for the parts of the gateway."""
    return is_left_out or name in _OF_PARTS


def find(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: Element) -> Element | None:
    """Find what is public under its public name, wherever it is written; and let names of Python be no references."""
    target = node["reftarget"]
    last = target.rpartition(".")[2]
    for name in (f"gateway.{target}", f"gateway.{last}", f"gateway.events.{last}"):
        found = env.domains["py"].resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, content)
        if found is not None:
            return found
    of_python = target.partition(".")[0]
    return content if of_python in sys.stdlib_module_names or hasattr(builtins, of_python) else None


def _is_event(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Event)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", write_docstring)
    app.connect("autodoc-process-signature", write_signature)
    app.connect("autodoc-skip-member", leave_out)
    app.connect("missing-reference", find)
