"""The link of a virtual port, and what else may be at its place."""

from pathlib import Path

import pytest

from gateway.errors import PortError
from gateway.ports.link_file import LinkFile


def test_it_leads_to_one_after_the_other(tmp_path: Path) -> None:
    place = tmp_path / "ttyHMI"
    link = LinkFile(place)
    link.lead_to("/dev/pts/1000")
    link.lead_to("/dev/pts/1001")
    assert place.readlink() == Path("/dev/pts/1001")
    link.remove()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("target", ["/dev/pts/1000", "/nowhere", "/dev/pts/ptmx"])
def test_what_a_killed_gateway_has_left_is_replaced(tmp_path: Path, target: str) -> None:
    """Another terminal may have the number meanwhile, so the link may lead somewhere."""
    place, is_replaced = tmp_path / "ttyHMI", target != "/dev/pts/ptmx"
    place.symlink_to(target)
    (tmp_path / ".ttyHMI.new").symlink_to(target)
    if is_replaced:
        LinkFile(place).lead_to("/dev/pts/1001")
        assert place.readlink() == Path("/dev/pts/1001")
        return
    with pytest.raises(PortError, match="is there already"):
        LinkFile(place).lead_to("/dev/pts/1001")
    assert place.readlink() == Path(target)


@pytest.mark.parametrize("name", ["ttyHMI", ".ttyHMI.new"])
def test_no_file_of_a_user_is_replaced(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    link = LinkFile(tmp_path / "ttyHMI")
    with pytest.raises(PortError):
        link.lead_to("/dev/pts/1001")
    link.remove()
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [(name, "mine")]


def test_a_link_that_somebody_has_replaced_is_left_alone(tmp_path: Path) -> None:
    place = tmp_path / "ttyHMI"
    link = LinkFile(place)
    link.lead_to("/dev/pts/1001")
    place.unlink()
    place.symlink_to("/dev/pts/1002")
    with pytest.raises(PortError, match="do two gateways have this port"):
        link.lead_to("/dev/pts/1003")
    link.remove()
    assert place.readlink() == Path("/dev/pts/1002")


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(PortError, match="cannot be made: No such file or directory; may this user write in"):
        LinkFile(tmp_path / "nowhere" / "ttyHMI").lead_to("/dev/pts/1001")
