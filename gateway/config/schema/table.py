"""A table of the config file, with its place there."""

from typing import Annotated, Any, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from gateway.config.problem import Path
from gateway.config.values.kind import Kind

FunctionNumber = Annotated[
    int, Field(ge=1, le=127), Kind("function", {"type": "integer", "minimum": 1, "maximum": 127})
]
Count = Annotated[int, Field(ge=1)]


class Table(BaseModel):
    """A table of the file. `path` and `place` say where it is, after `placed` was called.

    A property of a table is the default of a key where that follows from its other keys, and nothing else.
    """

    # Deferred: of most tables the validator is only needed inside that of the whole file, which builds it anyway.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)

    _path: Path = PrivateAttr(default=())
    _place: str = PrivateAttr(default="")

    @property
    def path(self) -> Path:
        """Give the way to the table from the top of the file."""
        return self._path

    @property
    def place(self) -> str:
        """Give file and line of the table, such as `gateway.toml:31`."""
        return self._place

    def placed(self, path: Path, place: str) -> Self:
        """Set the place of this table. Called once, after the file was read."""
        self._path = path
        self._place = place
        return self

    def has(self, key: str) -> bool:
        """Tell whether the user has written the field `key`."""
        return key in self.model_fields_set


def keys_of(model: type[Table]) -> list[str]:
    """List the keys of a table, as a user writes them."""
    return [field.alias or name for name, field in model.model_fields.items()]


def row_model(annotation: Any) -> type[Table] | None:
    """Find the table inside a type such as `tuple[Device, ...] | None`, if there is one."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((model for part in get_args(annotation) if (model := row_model(part))), None)
