"""What `deploy/compile` has to know of some classes (docs/adr/0012). Where they are not compiled it means nothing.

- `allow_interpreted_subclasses`: classes that are not compiled may have it as their base.
- `free_list_len`: made for each request, so the last one that was freed is used again.
- `acyclic`: it refers to nothing that refers to it, so Python's garbage collector need not look at it.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

__all__ = ["mypyc_attr"]

if TYPE_CHECKING:
    from mypy_extensions import mypyc_attr
else:
    Class = TypeVar("Class")

    def mypyc_attr(**_: object) -> Callable[[Class], Class]:
        """Return the class as it is."""
        return lambda cls: cls
