"""Finds the class of a unit that is made in Python."""

import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from functools import partial
from importlib import import_module, invalidate_caches
from pathlib import Path
from traceback import extract_tb, format_exception_only
from types import ModuleType
from typing import Final, TypeVar

from gateway.config.problem import WrongValue, did_you_mean
from gateway.images.custom_unit import CustomUnit

T = TypeVar("T")

#: How long a module may take to be imported, and a unit to be made, in seconds: a reload waits for ten.
IMPORT_TIME: Final = 8.0

#: Of what it raises, at most so many characters are told.
_MOST_SAID: Final = 200
#: How `read` and `write` are called.
_PARAMETERS: Final = {"read": ("area", "address", "count"), "write": ("area", "address", "values")}
#: Files of a folder that are no modules of units.
_NO_MODULES: Final = ("__init__", "__main__", "setup", "conftest")


def unit_trouble(python: str, folder: Path) -> WrongValue | None:
    """Say why the class cannot be used; None if it can. It is imported, for IMPORT_TIME; its prints go to stderr."""
    with redirect_stdout(sys.stderr):
        try:
            in_time(python, partial(find_class, python, folder))
        except WrongValue as wrong:
            return wrong
    return None


def in_time(python: str, call: Callable[[], T]) -> T:
    """Carry out what has to do with the class `python` in a thread, and wait for it, for IMPORT_TIME at most.

    Raises:
        WrongValue: it takes longer; or what `call` raises.
    """
    from concurrent.futures import wait  # noqa: PLC0415 - few configs name a class

    from gateway.clock.threads import ThreadPerCall  # noqa: PLC0415

    outcome = ThreadPerCall(f"import {python}").submit(call)
    done, _ = wait([outcome], IMPORT_TIME)
    if not done:
        what = f"{python} could not be imported and made within {IMPORT_TIME:g} s"
        raise WrongValue(what, "let it do later what takes long, in read and write")
    try:
        return outcome.result()
    except KeyboardInterrupt as error:  # of the code: nobody interrupts a thread
        raise WrongValue(f"{python} cannot be imported and made: {told(error)}") from None


def find_class(python: str, folder: Path) -> type[CustomUnit]:
    """Import the class that `python` names, `module:Name`: from what is installed, or else from `folder`.

    The folder stays at the end of `sys.path`, for what the module imports later. Blocks for as long as its code does.

    Raises:
        WrongValue: there is no such class, or it cannot be a unit.
    """
    try:
        return _found(python, folder)
    except (WrongValue, KeyboardInterrupt):
        raise
    except BaseException as error:  # noqa: BLE001 - even a look at the code of others runs it
        raise WrongValue(f"{python} cannot be used: {told(error)}") from None


def _found(python: str, folder: Path) -> type[CustomUnit]:
    module_name, _, name = python.partition(":")
    module = _imported(module_name, folder)
    found = getattr(module, name, None)
    if found is None:
        known = (each.__name__ for each in _units_in(module))
        raise WrongValue(f"{module_name} has no class {name} ({_place_of(module)})", did_you_mean(name, known))
    if not isinstance(found, type) or not issubclass(found, CustomUnit) or found is CustomUnit:
        remedy = f"from gateway import CustomUnit, and write it as class {name}(CustomUnit)"
        raise WrongValue(f"{python} is not a subclass of CustomUnit ({_place_of(module)})", remedy)
    for what, remedy in _wrong_in(found):
        raise WrongValue(f"{python} {what} ({_place_of(module)})", remedy)
    return found


def _imported(name: str, folder: Path) -> ModuleType:
    """Import a module.

    Raises:
        WrongValue: there is none, or its code has failed.
    """
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    invalidate_caches()  # it may just have been copied there
    try:
        return import_module(name)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever the code of others raises
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if missing is not None and f"{name}.".startswith(f"{missing}."):
            raise _no_module(missing, folder) from None
        remedy = "" if missing is None else _how_to_install(missing, folder)
        raise WrongValue(f"{name} cannot be imported: {told(error)}", remedy) from None


def _no_module(name: str, folder: Path) -> WrongValue:
    beside = sorted({each.stem for each in folder.glob("*.py")} - {*_NO_MODULES})
    what = f"there is no module {name}: neither installed for {sys.executable} nor in {folder}"
    return WrongValue(what, did_you_mean(name, beside) or f"put {name}.py beside the config")


def told(error: BaseException) -> str:
    """Say in one line what code of others has raised, and where."""
    text = format_exception_only(error)[0].partition(": ")[2].rstrip("\n")
    said = f"{type(error).__name__}: {text[:_MOST_SAID]}".rstrip(": ").replace("\n", r"\n")
    if isinstance(error, SyntaxError):
        return f"{type(error).__name__}: {error.msg} ({error.filename}, line {error.lineno})"
    ours = [each for each in extract_tb(error.__traceback__) if not each.filename.startswith("<")]
    is_here = not ours or ours[-1].filename == __file__
    return said if is_here else f"{said} ({ours[-1].filename}, line {ours[-1].lineno})"


def _how_to_install(missing: str, folder: Path) -> str:
    """Say where a module is found that others need; the Debian package has no place for what is installed."""
    if any(each.endswith(("site-packages", "dist-packages")) for each in sys.path):
        return f"install it for the Python of the gateway, {sys.executable}"
    return f"pip install --target {folder} {missing.partition('.')[0]}"


def _units_in(module: ModuleType) -> Iterator[type[CustomUnit]]:
    for each in vars(module).values():
        if isinstance(each, type) and issubclass(each, CustomUnit) and each is not CustomUnit:
            yield each


def _place_of(module: ModuleType) -> str:
    return getattr(module, "__file__", None) or "it is a part of Python"


def _wrong_in(unit: type[CustomUnit]) -> Iterator[tuple[str, str]]:
    """Find what keeps a class from being a unit, and what to do."""
    missing = ", ".join(sorted(getattr(unit, "__abstractmethods__", ())))
    if missing:
        yield f"has no {missing}", "write it"
    if not _takes(unit):
        yield f"needs arguments, {inspect.signature(unit)}", "give them defaults: it is made without arguments"
    if unit.read is CustomUnit.read and unit.write is CustomUnit.write:
        yield "has neither read nor write", "write async def read(self, area, address, count)"
    yield from wrong_methods(unit, "self")


def wrong_methods(unit: CustomUnit | type[CustomUnit], *first: str) -> Iterator[tuple[str, str]]:
    """Find what is wrong with `read` and `write`, and what to do; those of a class take `first` before all else."""
    for name, parameters in _PARAMETERS.items():
        method = getattr(unit, name)
        head = f"write async def {name}(self, {', '.join(parameters)})"
        if not inspect.iscoroutinefunction(inspect.unwrap(method)):
            yield f"has a {name} that is not async", head
        elif not _takes(method, *first, *parameters):
            yield f"has a {name} with other parameters, {inspect.signature(method)}", head


def _takes(called: object, *arguments: str) -> bool:
    try:
        inspect.signature(called).bind(*arguments)  # type: ignore[arg-type]
    except TypeError:
        return False
    except ValueError:  # its __init__ is one of those in C that say nothing of what they take
        return True
    return True
