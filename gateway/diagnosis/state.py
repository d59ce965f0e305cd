"""Rules about the files of the state folder."""

from gateway.diagnosis.finding import Finding


def about_state_file(file: str, reason: str, *, was_damaged: bool) -> Finding:
    """Return the finding for a file or folder that cannot be written, or a file that was damaged at the start."""
    if was_damaged:
        return Finding("note", "state", f"{file} was damaged: {reason}", "check the disk, and the values of images")
    remedy = f"findmnt -T {file}; df {file}; ls -ld {file}: the user of the gateway must be able to write, with room"
    return Finding("fix", "state", f"{file} cannot be written: {reason}", remedy)
