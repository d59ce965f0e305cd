"""A config out of the `modbus:` section of Home Assistant's, or of a file that has only that."""

from collections.abc import Callable
from typing import Any, Final

from gateway.config.importing.from_home_assistant.device import DevicePart, Taken
from gateway.config.importing.from_home_assistant.document import Documents
from gateway.config.importing.from_home_assistant.hub import hub_parts
from gateway.config.importing.from_home_assistant.publishing import suggestion
from gateway.config.importing.imported import Imported, ImportedFileError, read_file
from gateway.config.importing.points import Check, ProfilePart, write
from gateway.config.importing.yaml_text import Table
from gateway.config.reading.toml_text import TableText

_SECTION: Final = "modbus"
#: What the suggestion at the end needs at the top.
_SITE: Final = ("For the [mqtt] at the end:", 'site = "home"')


def config_from_home_assistant(file: str, check: Check, read: Callable[[str], str] = read_file) -> Imported:
    """Write the config that asks the devices of this `file`.

    Raises:
        ImportedFileError: nothing of it can be used.
    """
    documents, taken = Documents(file, read), Taken()
    parts: list[TableText | ProfilePart] = [TableText("", comments=(f"From Home Assistant: {file}", *_SITE))]
    left_out: list[str] = []
    devices: list[DevicePart] = []
    for hub in _hubs(documents):
        try:
            tables, found = hub_parts(hub, documents, taken)
        except ImportedFileError as wrong:
            left_out.append(str(wrong))
            tables, found = [TableText("", comments=(f"Left out: {wrong}",))], []
        parts += tables
        devices += found
    imported = write("", parts, check, left_out)
    lines = suggestion(devices)  # of the points that are left
    return imported._replace(text=imported.text + "".join(f"\n# {line}" for line in lines) + "\n" * bool(lines))


def _hubs(documents: Documents) -> list[Any]:
    """Find the connections: those of the section, or all that is in the file."""
    document = documents.document()
    if isinstance(document, Table) and _SECTION in document:
        document = documents.follow(document[_SECTION])
    elif isinstance(document, Table) and "type" not in document:
        document = None
    hubs = document if isinstance(document, list) else [document]
    if not hubs or hubs == [None]:
        raise ImportedFileError(f"{documents.file}: there is no {_SECTION}: in it")
    return hubs
