"""What is in a diagnostics bundle."""

import io
import tarfile


def documents_in(packed: bytes) -> dict[str, str]:
    """The documents of a bundle by their names, without the folder that all of them are in."""
    with tarfile.open(fileobj=io.BytesIO(packed), mode="r:gz") as archive:
        members = archive.getmembers()
        assert len({each.name.partition("/")[0] for each in members}) == 1
        return {each.name.partition("/")[2]: archive.extractfile(each).read().decode() for each in members}
