"""Rules about the files of the state folder."""

from typing import Final

from gateway.diagnosis.finding import Finding

#: The end of the reason where another gateway has the file open.
OTHER_GATEWAY: Final = "is another modbus-gateway running?"
_A_FOLDER_FOR_EACH: Final = (
    "start one of the two with a folder of its own: STATE_DIRECTORY=FOLDER modbus-gateway run ..."
)


def about_state_file(file: str, reason: str, *, was_damaged: bool) -> Finding:
    """Return the finding for a file or folder that cannot be written, or a file that was damaged at the start."""
    if was_damaged:
        return Finding("note", "state", f"{file} was damaged: {reason}", "check the disk, and the values of images")
    if reason.endswith(OTHER_GATEWAY):
        return Finding("fix", "state", f"{file} cannot be written: {reason}", _A_FOLDER_FOR_EACH)
    remedy = f"findmnt -T {file}; df {file}; ls -ld {file}: the user of the gateway must be able to write, with room"
    return Finding("fix", "state", f"{file} cannot be written: {reason}", remedy)
