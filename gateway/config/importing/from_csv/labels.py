"""Labels of numbers, as `profile NAME --csv` writes them or as people do."""

import json
import re
from typing import Final

from gateway.config.reading.toml_text import Value
from gateway.profiles.columns import labels_of

#: Longer cells are read by people only.
_LONGEST: Final = 3000
_KEY: Final = re.compile(r"-?(?:0x[0-9a-f]+|\d+)", re.IGNORECASE)
#: Labels as people write them, without an `=`: 0: off, 1: running.
_LABEL: Final = re.compile(
    r"(-?(?:0x[0-9a-f]+|\d+))\s*[:：=\-–→]+\s*(.*?)\s*(?:[;,/、，；\n]+\s*|\s+)(?=-?(?:0x[0-9a-f]+|\d+)\s*[:：=\-–→]|$)",
    re.IGNORECASE | re.DOTALL,
)


def labels_in(cell: str) -> dict[str, Value]:
    """Parse labels as `profile NAME --csv` writes them, or as people do; none if it is something else."""
    if len(cell) > _LONGEST:
        return {}
    labels: dict[str, Value] = {number: text for number, text in labels_of(cell) if text}
    if not labels or not all(_KEY.fullmatch(number) for number in labels):
        found = _json_labels(cell) if cell.startswith("{") else dict(_LABEL.findall(f"{cell}\n"))
        has_words = len(found) > 1 and all(re.search(r"[^\W\d]", str(text)) for text in found.values())
        labels = found if has_words else {}  # 0-100 is a range
    texts = list(labels.values())
    is_usable = len(set(map(str, texts))) == len(texts) and all(
        isinstance(text, str) and text.strip() for text in texts
    )
    return labels if is_usable else {}


def _json_labels(cell: str) -> dict[str, Value]:
    try:
        found = json.loads(cell)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) and all(map(_KEY.fullmatch, found)) else {}
