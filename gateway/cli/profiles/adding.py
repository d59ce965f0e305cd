"""`profile add`: a file that becomes a profile of this machine, or of a config."""

import os
import sys
from pathlib import Path
from typing import Final

from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.config.load import load_profile
from gateway.config.machine.profile_folders import BESIDE, OWN_PROFILES
from gateway.config.problem import errors_in
from gateway.config.profile_files import ProfileFiles, in_words
from gateway.errors import ConfigError
from gateway.profiles import is_file_name
from gateway.state.files import replace

#: Rights of the folder and of the files in it: the service has a user of its own.
_FOLDER_MODE: Final = 0o755
_FILE_MODE: Final = 0o644


def add_profile(file: Path, to: str | None, config: str | None, *, force: bool) -> int:
    """Check a file, and copy it to where configs find it; 1 if it has errors, or if another file would be lost.

    Raises:
        WrongUsageError: the name of the profile cannot be that of a file.
        ConfigError: the file cannot be written.
    """
    checked = load_profile(file)
    for problem in checked.problems:
        print(problem, file=sys.stderr)
    if errors_in(checked.problems):
        return PROBLEM_FOUND
    if not is_file_name(checked.name):
        raise WrongUsageError(
            f'"{checked.name}" cannot be the name of a file', "letters, digits, - _ and . are allowed"
        )
    folder = OWN_PROFILES if to is None and config is None else Path(to or Path(config or "").parent / BESIDE)
    target = folder / f"{checked.name}.toml"
    try:
        if not _put(target, checked.text, force=force):
            return PROBLEM_FOUND
    except OSError as error:
        advice = "; run it as root, or name another folder with --to" if isinstance(error, PermissionError) else ""
        raise ConfigError(f"{target}: {error.strerror}{advice}") from error
    hidden = ProfileFiles((folder, OWN_PROFILES)).places(checked.name)[1:]
    hides = f", and hides {in_words(hidden)}" if hidden else ""
    print(
        f'{checked.name} is in {target}{hides}.\nIn the config: profile = "{checked.name}". Then: modbus-gateway reload'
    )
    return FINE


def _put(target: Path, text: str, *, force: bool) -> bool:
    """Write the file, unless another one is there."""
    if os.path.lexists(target) and not force and target.read_text(encoding="utf-8") != text:
        print(f"modbus-gateway: error: {target} is there already, and differs", file=sys.stderr)
        print("  help: --force replaces it", file=sys.stderr)
        return False
    if not target.parent.exists():
        target.parent.mkdir(parents=True)
        target.parent.chmod(_FOLDER_MODE)
    replace(target, text.encode())
    target.chmod(_FILE_MODE)
    return True
