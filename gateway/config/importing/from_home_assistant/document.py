"""Files of Home Assistant: YAML with tags of its own, which are followed when they are needed.

`!include` is followed to files below the folder of the first one, `!secret` to `secrets.yaml` there. Any other tag is a
value that is not known here.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any, Final

from gateway.config.importing.imported import ImportedFileError
from gateway.config.importing.yaml_text import Tagged, parse_located_yaml, plain_text

_SECRETS: Final = "secrets.yaml"
_MOST_FILES: Final = 100


@dataclass(slots=True)
class Documents:
    """The files of a config: `read` returns the text of one, by its path."""

    file: str
    read: Callable[[str], str]
    _loaded: dict[str, Any] = field(default_factory=dict)

    def document(self) -> Any:
        """Parse the first file."""
        return self._load(self.file)

    def follow(self, value: Any) -> Any:
        """Return the value itself, or what its tag leads to."""
        for _ in range(_MOST_FILES):
            if not isinstance(value, Tagged):
                return value
            value = self._followed(value)
        raise ImportedFileError("it includes itself")

    def _followed(self, tagged: Tagged) -> Any:
        name = plain_text(tagged.value)
        if not name:
            raise ImportedFileError(f"{tagged.tag} names nothing")
        if tagged.tag == "!include":
            path = PurePosixPath(name)
            if path.is_absolute() or ".." in path.parts:
                raise ImportedFileError(f"!include {name} is not below the folder of the file: import that file itself")
            return self._load(self._beside(name))
        if tagged.tag == "!secret":
            secrets = self._load(self._beside(_SECRETS))
            if not isinstance(secrets, dict) or name not in secrets:
                raise ImportedFileError(f"!secret {name}: there is no {name} in {_SECRETS}")
            return secrets[name]
        remedy = "import its files one by one" if tagged.tag.startswith("!include") else "write the value itself"
        raise ImportedFileError(f"{tagged.tag} is not known here: {remedy}")

    def _beside(self, name: str) -> str:
        folder, slash, _ = self.file.rpartition("/")
        return f"{folder}{slash}{name}"

    def _load(self, file: str) -> Any:
        if file not in self._loaded:
            if len(self._loaded) >= _MOST_FILES:
                raise ImportedFileError(f"more than {_MOST_FILES} files are included")
            try:
                self._loaded[file] = parse_located_yaml(self.read(file), file.rpartition("/")[2])
            except ValueError as wrong:
                raise ImportedFileError(f"{file}: {wrong}") from None
            except RecursionError:
                raise ImportedFileError(f"{file}: is nested too deeply") from None
        return self._loaded[file]
