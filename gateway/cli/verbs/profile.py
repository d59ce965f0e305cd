"""`profile`: kinds of devices: which there are, what one accepts, and how to add one."""

import argparse
import os
import sys
from pathlib import Path
from typing import Final

from gateway.cli.kit.usage import WrongUsageError, baud, let_options_stand_anywhere, parsed_by
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.profiles.known import BrokenFileError, Profiles, find_matching, list_as_json, list_as_text
from gateway.cli.profiles.picture import picture_as_json, picture_as_text
from gateway.config.documents.points import points_csv
from gateway.config.load import load_profile
from gateway.config.machine.profile_folders import BESIDE, OWN_PROFILES
from gateway.config.problem import errors_in
from gateway.config.profile_files import ProfileFiles, in_words
from gateway.config.values.port import DEFAULT_FORMATS, fits_mode, parse_format
from gateway.errors import ConfigError
from gateway.profiles import is_file_name
from gateway.state.files import replace
from gateway.timing.characters import CharacterFormat, LineTiming

_LIST: Final = "list"
_ADD: Final = "add"
#: Rights of the folder and of the files in it: the service has a user of its own.
_FOLDER_MODE: Final = 0o755
_FILE_MODE: Final = 0o644


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `profile`."""
    let_options_stand_anywhere(parser)
    parser.add_argument("name", nargs="?", default=_LIST, metavar="NAME|list|add", help="the profile (default: list)")
    parser.add_argument("file", nargs="?", metavar="FILE", help="with add: the file; with list: a word to look for")
    parser.add_argument("--baud", type=baud, default=19200, metavar="N", help="baud rate of the line (default 19200)")
    format_ = parsed_by(parse_format)
    parser.add_argument("--format", type=format_, metavar="F", help="character format (default 8E1, ASCII 7E1)")
    parser.add_argument("--mode", choices=("rtu", "ascii"), help="mode of the line (default rtu, mint ascii)")
    parser.add_argument("--config", metavar="FILE", help="config file with more profiles, in it and beside it")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print JSON instead of tables")
    output.add_argument("--csv", action="store_true", help="print the points of NAME as CSV, for import csv")
    parser.add_argument(
        "--to", metavar="folder", help=f"with add: the folder (default {OWN_PROFILES}, or profiles beside --config)"
    )
    parser.add_argument("--force", action="store_true", help="with add: replace a file that is there")


def run(args: argparse.Namespace) -> int:
    """Print or add a profile, or print the list; 1 if a file has errors, 2 if there is no such profile."""
    try:
        return _run(args)
    except BrokenFileError as broken:
        print(*broken.problems, sep="\n", file=sys.stderr)
        return PROBLEM_FOUND


def _run(args: argparse.Namespace) -> int:
    if args.name == _ADD and args.file is None:
        raise WrongUsageError("profile add needs a file", "modbus-gateway profile add FILE")
    if args.name == _ADD:
        return add_profile(Path(args.file), args.to, args.config, force=args.force)
    if args.name == _LIST:
        return _list(args)
    if args.file is not None:
        raise WrongUsageError(f"{args.file} is one word too many", f"modbus-gateway profile {args.name}")
    return _show(args)


def _list(args: argparse.Namespace) -> int:
    word = args.file or ""
    known, problems = find_matching(Profiles(args.config), word)
    for problem in problems:
        print(problem, file=sys.stderr)
    if args.json:
        print(list_as_json(known))
    elif known:
        print(list_as_text(known))
    else:
        print(f'no profile has "{word}" in its name, title or maker')
    return PROBLEM_FOUND if problems or not known else FINE


def _show(args: argparse.Namespace) -> int:
    found = Profiles(args.config).get(args.name)
    if args.csv:
        sys.stdout.write(points_csv(found.table))
        return FINE
    mode = args.mode or found.table.mode or "rtu"
    format_: CharacterFormat = args.format or DEFAULT_FORMATS[mode]
    if not fits_mode(format_, mode):
        what = f"RTU needs 8 data bits, and {format_} has {format_.data_bits}"
        raise WrongUsageError(what, "is it --mode ascii?")
    timing = LineTiming(mode, args.baud, format_)
    print(picture_as_json(found, timing) if args.json else picture_as_text(found, timing))
    return FINE


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
