"""The config of an embedded gateway: a file, a text, or a table that the program has made; with its units."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from gateway.config.checks.embedding import Embedding
from gateway.config.load import Loaded, Troubles, load, load_table, load_text
from gateway.config.machine.file_text import folder_of
from gateway.config.machine.troubles import address_trouble
from gateway.config.machine.unit_class import find_class, wrong_methods
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, WrongValue, error
from gateway.errors import ConfigError
from gateway.images.custom_unit import CustomUnit
from gateway.readconfig.process import ConfigRead, ReadConfig

#: The units that a program has made, by the number that clients use.
Units = Mapping[int, CustomUnit]

#: What stands for the file of a config that is none.
_TEXT, _TABLE = Path("<text>"), Path("<dict>")
_FIXED: Final = "the config is a {} of the program that runs this gateway, and cannot be read again"


@dataclass(frozen=True, slots=True)
class GivenConfig:
    """A config without errors: its `plan`, and its `problems`, which are warnings.

    `file` is an absolute path: the program may go to another folder. It says from where paths count; `fixed` why there
    is none that `read` could read again, empty if there is one.
    """

    plan: Plan
    problems: tuple[Problem, ...]
    file: Path
    read: ReadConfig
    text: str = ""
    profile_texts: Mapping[str, str] = field(default_factory=dict)
    fixed: str = ""

    @property
    def place(self) -> str:
        """Say where it comes from."""
        return self.file.name if self.fixed else str(self.file)


def read_file(path: str | Path, units: Units, *, has_state: bool) -> GivenConfig:
    """Read and check the file at `path`, with the `units` of the program. `read` reads it as it is then.

    Raises:
        ConfigError: it has errors.
    """
    file, embedding = Path(path), _embedding(units, has_state=has_state)
    return _given(_load(file, embedding), file, read=partial(_read_again, embedding))


def read_text(text: str, folder: str | Path, units: Units, *, has_state: bool) -> GivenConfig:
    """Read and check a text, whose paths and own profiles are in `folder`; otherwise as `read_file`."""
    if not isinstance(text, str):
        raise TypeError(f"from_text takes the text of a config, not {type(text).__name__}; from_toml takes a path")
    embedding = _embedding(units, has_state=has_state)
    file = folder / _TEXT
    loaded = load_text(text, file, embedding, **_looking_from(file))
    return _given(loaded, file, fixed=_FIXED.format("text"))


def read_table(table: Mapping[str, Any], folder: str | Path, units: Units, *, has_state: bool) -> GivenConfig:
    """Read and check a table, which is neither changed nor kept; otherwise as `read_text`."""
    if not isinstance(table, Mapping):
        raise TypeError(f"a config is a dict, not {type(table).__name__}; from_toml takes a path, from_text a text")
    embedding = _embedding(units, has_state=has_state)
    file = folder / _TABLE
    loaded = load_table(table, file, embedding, **_looking_from(file))
    return _given(loaded, file, fixed=_FIXED.format("dict"))


def _given(loaded: Loaded, file: Path, *, read: ReadConfig | None = None, fixed: str = "") -> GivenConfig:
    if fixed and loaded.config is not None and loaded.config.include:
        wrong = error(("include",), "only a file includes others", "Gateway.from_toml(PATH) reads one")
        loaded = replace(loaded, config=None, problems=(wrong.located(file.name, 0, 0),))
    found = _config_read(loaded)
    if found.plan is None:
        raise ConfigError("\n".join(found.errors), found.problems)
    again: ReadConfig = read or _Same(found)
    return GivenConfig(found.plan, found.problems, file.absolute(), again, found.text, found.profile_texts, fixed)


@dataclass(frozen=True, slots=True)
class _Same:
    """Reads a config that cannot change."""

    found: ConfigRead

    def __call__(self, file: Path, *, look_around: bool = False) -> ConfigRead:  # noqa: ARG002 - see ReadConfig
        return self.found


def _read_again(embedding: Embedding, file: Path, *, look_around: bool = False) -> ConfigRead:
    """See ReadConfig. The program may be no Python that could start a process to read it, as the daemon does."""
    loaded = _load(file, embedding)
    if look_around:
        from gateway.readconfig.file_troubles import with_file_troubles  # noqa: PLC0415 - only needed for this

        loaded = with_file_troubles(loaded, str(file))
    return _config_read(loaded)


def _load(file: Path, embedding: Embedding) -> Loaded:
    return load(file, embedding, **_looking_from(file))


def _looking_from(file: Path) -> Troubles:
    """Make what looks at addresses, and what imports a class that the config names and says why it cannot be used."""
    folder = folder_of(file)

    def trouble(python: str) -> WrongValue | None:
        if ":" not in python:  # a unit of the program
            return None
        try:
            find_class(python, folder)
        except WrongValue as wrong:
            return wrong
        return None

    return {"address_trouble": address_trouble, "unit_trouble": trouble}


def _config_read(loaded: Loaded) -> ConfigRead:
    return ConfigRead(loaded.plan, loaded.problems, loaded.text, loaded.profile_texts)


def _embedding(units: Units, *, has_state: bool) -> Embedding:
    """Check what a program has given.

    Raises:
        TypeError: something of it is no unit, or has no number.
    """
    if not isinstance(units, Mapping):
        raise TypeError(f"units: write a dict such as {{60: Clock()}}, not {type(units).__name__}")
    for number, unit in units.items():
        if type(number) is not int:
            raise TypeError(f"units[{number!r}]: the number of a unit is an int")
        if isinstance(unit, type):
            raise TypeError(f"units[{number}] is the class {unit.__name__}: write {unit.__name__}()")
        if not isinstance(unit, CustomUnit):
            raise TypeError(f"units[{number}] is {unit!r:.60}, and no CustomUnit")
        for what, remedy in wrong_methods(unit):
            raise TypeError(f"units[{number}]: {type(unit).__name__} {what}: {remedy}")
    return Embedding({number: type(unit).__name__ for number, unit in units.items()}, has_state=has_state)
