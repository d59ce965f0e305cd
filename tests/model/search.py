"""Every order of happenings up to a depth, each state once, by breadth: the first way to something wrong is a shortest.

A state is reached again by letting happen what has led to it, so that any machine can be searched, and none is copied.
"""

from dataclasses import dataclass, field

from model.letters import do, drain, enabled
from model.world import Setting, World

Path = tuple[str, ...]


@dataclass
class Search:
    """How many states there are, and by how many happenings they were reached; the way to what is wrong, its story."""

    setting: Setting
    depth: int = 0
    states: int = 1
    happenings: int = 0
    path: Path = ()
    story: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        found = f"{self.setting.name}: depth {self.depth}, {self.states} states, {self.happenings} happenings"
        return "\n".join([found, *self.story, *self.wrong])


def replay(setting: Setting, path: Path = ()) -> World:
    """The world in which all this has happened."""
    world = World(setting)
    for name in (*setting.before, *path):
        do(world, name)
    return world


def search(setting: Setting, depth: int) -> Search:
    """Go through all orders of so many happenings, until something is wrong."""
    found = Search(setting)
    seen = {replay(setting).picture()}
    paths: list[Path] = [()]
    while paths and found.depth < depth and not found.wrong:
        found.depth += 1
        paths = [longer for path in paths for longer in _steps(found, path, seen)]
    found.states = len(seen)
    return found


def _steps(found: Search, path: Path, seen: set[int]) -> list[Path]:
    """The ways that lead on from here to states that nobody has seen."""
    steps = []
    for name in [] if found.wrong else enabled(replay(found.setting, path)):
        longer = (*path, name)
        world = replay(found.setting, longer)
        found.happenings += 1
        picture = world.picture()
        if picture in seen and not world.wrong:
            continue
        seen.add(picture)
        steps.append(longer)
        drain(world)
        if world.wrong:
            found.path, found.story, found.wrong = longer, world.story, world.wrong
            break
    return steps
