"""The answers of `support`."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Document:
    """A text for a diagnostics bundle, or a part of it: parts have the same `name`. `missing`: why there is none."""

    name: str
    text: str = ""
    missing: str = ""
