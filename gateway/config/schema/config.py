"""A whole config file: its sections. docs/configuration.md is made from the tables in this folder."""

from collections.abc import Mapping
from typing import Annotated, Final

from pydantic import Field

from gateway.config.schema.access import Access
from gateway.config.schema.fleet import Fleet
from gateway.config.schema.gateway import Control, Log, Own, Trace
from gateway.config.schema.image import Image
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.mqtt import Mqtt
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.table import Table
from gateway.config.schema.upstream import Upstream
from gateway.config.schema.web import Web
from gateway.config.values.key_types import (
    ListOf,
)

#: The section of profiles.
PROFILE: Final = "profile"


class Config(Table):
    """A whole file."""

    site: str = Field(
        "",
        description="The name of the plant: in the titles of web pages, in the topics of `[mqtt]`, and its name in "
        "`[fleet]`.",
    )
    listen: Annotated[tuple[Listen, ...], ListOf] = ()
    line: Annotated[tuple[Line, ...], ListOf] = ()
    image: Annotated[tuple[Image, ...], ListOf] = ()
    upstream: Annotated[tuple[Upstream, ...], ListOf] = ()
    profile: Mapping[str, ProfileTable] = Field({})
    access: Annotated[tuple[Access, ...], ListOf] = ()
    own: Own | None = Field(None, alias="self")
    web: Web | None = None
    mqtt: Mqtt | None = None
    fleet: Fleet | None = None
    trace: Trace = Trace()
    control: Control | None = None
    log: Log = Log()

    @property
    def listens_by_default(self) -> bool:
        """Whether there is the default listener: the file says nothing of any. `listen = []` says there is none."""
        return not self.has("listen")
