"""The commands that make a file the config of the running gateway: it never writes it itself."""

import grp
import os
import pwd
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from shlex import quote

from gateway.runtime.reload import Reloader


def commands_to_apply(reloader: Reloader, new: Path | None = None) -> Sequence[str]:
    """List the commands that make the file `new` the config and reload it; one in the working folder if it is None.

    The new file is checked in the folder of the config, from where its paths count, and takes the place of the old one
    as a whole, with the same owner and rights. There are none for a config that comes from a program. Blocks for a
    moment.
    """
    if reloader.fixed:
        return ()
    order = "sudo " if reloader.is_service else ""
    # A link stays one: what it leads to is replaced.
    file = os.path.realpath(reloader.file)
    beside = quote(f"{file}.new")
    source = quote(str(new) if new is not None else reloader.file.name)
    return (
        f"{order}install {_rights(file, has_root=reloader.is_service)} {source} {beside}",
        f"{order}modbus-gateway check {beside} && {order}mv {beside} {quote(file)} && {order}modbus-gateway reload",
    )


def commands_to_include(reloader: Reloader, new: Mapping[str, Path], without: Iterable[str]) -> Iterator[str]:
    """Write commands that put files in the place of those that the config includes, and move others out of the way.

    They are called as from the folder of the config.
    """
    order = "sudo " if reloader.is_service else ""
    for name, source in new.items():
        file = os.path.realpath(reloader.file.parent / name)
        yield f"{order}install -D {_rights(file, has_root=reloader.is_service)} {quote(str(source))} {quote(file)}"
    for name in sorted(without):
        file = str(reloader.file.parent.absolute() / name)
        yield f"{order}mv {quote(file)} {quote(f'{file}.before')}"


def _rights(file: str, *, has_root: bool) -> str:
    """Write the rights of the present file, and its owner if another one could be given."""
    try:
        status = Path(file).stat()
    except OSError:
        return "-m 644"
    mode = f"-m {stat.S_IMODE(status.st_mode):o}"
    if has_root:
        with suppress(KeyError):
            owner, group = pwd.getpwuid(status.st_uid).pw_name, grp.getgrgid(status.st_gid).gr_name
            return mode if (owner, group) == ("root", "root") else f"-o {quote(owner)} -g {quote(group)} {mode}"
    return mode
