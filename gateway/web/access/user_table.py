"""The users as they are now: the file is checked from time to time, in a thread."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from gateway.clock.beside import end
from gateway.clock.threads import in_thread
from gateway.errors import UsersError
from gateway.readconfig.page_users import Users, read_users

#: How often the file is checked, in seconds.
LOOKED_AT_EVERY: Final = 5.0

_Look = tuple[int, ...] | None


class UserTable:
    """The users of `file`; none without one. `rejected` is called with the reason when it cannot be used any more.

    `users` are those who can log in, by name; `programs` those with a token, by its hash.
    """

    def __init__(self, file: Path | None, rejected: Callable[[str], None]) -> None:
        self.users: Users = {}
        self.programs: Users = {}
        self._file = file
        self._rejected = rejected
        self._look: _Look = None

    @asynccontextmanager
    async def kept_up_to_date(self) -> AsyncIterator[None]:
        """Keep the users up to date with the file inside the context.

        Raises:
            OSError: it cannot be read.
            UsersError: others may read or change it, or a line is invalid.
        """
        if self._file is None:
            yield
            return
        await self._read(self._file)
        task = asyncio.create_task(self._keep(self._file), name="web users")
        try:
            yield
        finally:
            await end(task)

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
        self._look, users = await in_thread("web users", _read, file, self._look)
        if users is not None:
            self.users = {name: user for name, user in users.items() if not user.is_program}
            self.programs = {user.hash: user for user in users.values() if user.is_program}


def _read(file: Path, before: _Look) -> tuple[_Look, Users | None]:
    """Read what identifies this state of the file, and its users if that has changed.

    Raises:
        UsersError: others may read or change it, or a line is invalid.
    """
    status = file.stat()
    look = (status.st_ino, status.st_mtime_ns, status.st_size, status.st_mode)
    if look == before:
        return look, None
    if status.st_mode & 0o027:
        raise UsersError(f"{file}: others may read or change it; chmod o=,g-w {file}")
    return look, read_users(file)
