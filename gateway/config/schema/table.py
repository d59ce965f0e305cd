"""A table of the config file, with its place there."""

from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from gateway.config.problem import Path
from gateway.config.values.kind import Kind

FunctionNumber = Annotated[
    int, Field(ge=1, le=127), Kind("function", {"type": "integer", "minimum": 1, "maximum": 127})
]
Count = Annotated[int, Field(ge=1)]


class Table(BaseModel):
    """A table of the file. `path` and `source` are its place, after `placed` was called."""

    # Deferred: of most tables the validator is only needed inside that of the whole file, which builds it anyway.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)

    _path: Path = PrivateAttr(default=())
    _source: str = PrivateAttr(default="")

    @property
    def path(self) -> Path:
        """The way to the table from the top of the file."""
        return self._path

    @property
    def source(self) -> str:
        """File and line of the table, such as `gateway.toml:31`."""
        return self._source

    def placed(self, path: Path, source: str) -> Self:
        """Set the place of this table. Called once, after the file was read."""
        self._path = path
        self._source = source
        return self

    def has(self, key: str) -> bool:
        """Whether the user has written the field `key`."""
        return key in self.model_fields_set
