"""Keeps the trends of all points while the gateway runs.

The file is written every ten minutes, soon after a block of time has ended, and at a stop: a power cut loses what was
heard since the last write.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

from gateway.operator.kept_file import KeptFile, in_thread
from gateway.operator.operator import Operator
from gateway.operator.trends.sampler import Sampler
from gateway.operator.trends.table import TABLE
from gateway.operator.trends.trends import Newest, Trends
from gateway.state.database import Database
from gateway.timing.trend import Layout, Slot

T = TypeVar("T")

FILE_NAME: Final = "trends.sqlite"
#: The file is written so often, and so many seconds after a block of time has ended.
WRITE_EVERY: Final = 600
_AFTER: Final = 5


class KeptTrends:
    """The trends of all points: in memory, and in the `file` if there is one."""

    def __init__(self, trends: Trends, file: "KeptFile[...] | None" = None) -> None:
        pass
