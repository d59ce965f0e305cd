"""The users as they are now: the file is looked at again from time to time, in a thread."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from gateway.clock.threads import ThreadPerCall
from gateway.errors import UsersError
from gateway.readconfig.page_users import Users, read_users

#: How often the file is looked at, in seconds.
LOOKED_AT_EVERY: Final = 5.0

_Look = tuple[int, ...] | None


class UserTable:
    """The users of `file`; none without one. What `rejected` tells of a file that cannot be used any more."""

    def __init__(self, file: Path | None, rejected: Callable[[str], None]) -> None:
        self.users: Users = {}
        self._file = file
        self._rejected = rejected
        self._look: _Look = None

    @asynccontextmanager
    async def kept_up_to_date(self) -> AsyncIterator[None]:
        """In its context the users are those of the file.

        Raises:
            OSError: it cannot be read.
            UsersError: a line of it is none of a user.
        """
        if self._file is None:
            yield
            return
        await self._read(self._file)
        task = asyncio.create_task(self._keep(self._file), name="web users")
        try:
            yield
        finally:
            task.cancel()

    async def _keep(self, file: Path) -> None:
        while True:
            await asyncio.sleep(LOOKED_AT_EVERY)
            before = self._look
            try:
                await self._read(file)
            except (OSError, UsersError) as error:
                self._look = None
                if before is not None:
                    self._rejected(str(error))

    async def _read(self, file: Path) -> None:
        loop = asyncio.get_running_loop()
        look, users = await loop.run_in_executor(ThreadPerCall("web users"), _read, file, self._look)
        self._look, self.users = look, self.users if users is None else users


def _read(file: Path, before: _Look) -> tuple[_Look, Users | None]:
    """What the file looks like, and its users if that is not as before."""
    status = file.stat()
    look = (status.st_ino, status.st_mtime_ns, status.st_size, status.st_mode)
    if look == before:
        return look, None
    if status.st_mode & 0o027:
        raise UsersError(f"{file}: others may read or change it; chmod o=,g-w {file}")
    return look, read_users(file)
