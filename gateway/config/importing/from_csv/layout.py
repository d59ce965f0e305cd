"""How the registers of a row carry its value: number, type, the bits that count; and labels of numbers."""

import json
import re
from typing import Final

from gateway.config.importing.from_csv.place import Place
from gateway.config.importing.from_csv.words import TypeWords
from gateway.config.importing.imported import ImportedFileError
from gateway.config.reading.toml_text import Value
from gateway.modbus.codes import Area
from gateway.profiles.columns import labels_of
from gateway.registers.items import has_bits

_BITS_OF_WHOLE: Final = (8, 16, 32, 64)
_BITS_OF_FLOAT: Final = (32, 64)
_BITS_OF_BCD: Final = (16, 32)
#: Longer cells are read by people only.
_LONGEST: Final = 3000
_KEY: Final = re.compile(r"-?(?:0x[0-9a-f]+|\d+)", re.IGNORECASE)
#: Labels as people write them, without an `=`: 0: off, 1: running.
_LABEL: Final = re.compile(
    r"(-?(?:0x[0-9a-f]+|\d+))\s*[:：=\-–→]+\s*(.*?)\s*(?:[;,/、，；\n]+\s*|\s+)(?=-?(?:0x[0-9a-f]+|\d+)\s*[:：=\-–→]|$)",
    re.IGNORECASE | re.DOTALL,
)


def type_keys_of(
    area: Area, words: TypeWords | None, place: Place, length: str, heading: str
) -> tuple[int, dict[str, Value]]:
    """Find the registers of a row, and the keys for its type."""
    if has_bits(area):
        return 1, {}
    registers = _registers(length, heading)
    span = place.last - place.first + 1
    if words is None:
        if (registers or span) > 1:
            raise ImportedFileError(f"it has {registers or span} registers, and no type")
        return 1, {}
    if words.kind == "string":
        count = registers or (span if span > 1 else -(-(words.characters or 0) // 2))
        if not count:
            raise ImportedFileError("a string needs a length: the number of its registers")
        return count, {"type": "string", "length": count}
    bits = words.bits or (16 * (registers or (span if span in (2, 4) else 1)))
    if words.kind == "float" and words.bits is None and registers is None and span == 1:
        bits = 32
    if words.kind == "bool":
        return 1, {}
    known = {"float": _BITS_OF_FLOAT, "bcd": _BITS_OF_BCD}.get(words.kind, _BITS_OF_WHOLE)
    if bits not in known:
        raise ImportedFileError(f"{words.kind} of {bits} bits is not known here")
    count = -(-bits // 16)
    if registers is not None and registers not in (count, span):
        raise ImportedFileError(f"{words.kind}{bits} takes {count} registers, and it has {registers}")
    kind = f"{words.kind}{bits}"
    return count, {} if kind == "uint16" else {"type": kind}


def bits_of(place: Place, cell: str, type_keys: dict[str, Value]) -> dict[str, Value]:
    """Make the keys for a part of a register. A byte is the low one unless the row says something else."""
    kind = str(type_keys.get("type", "uint16"))
    text = cell.lower().removeprefix("bits").removeprefix("bit").strip()
    if kind in ("uint8", "int8"):
        return {"byte": "high" if text in ("high", "hi", "h", "8-15", "15-8") or place.bit == 8 else "low"}
    if text in ("high", "low"):
        return {"byte": text}
    found = re.fullmatch(
        r"(\d{1,2})(?:\s*(?:-|–|~|to|\.\.|:)\s*(\d{1,2}))?", text or str("" if place.bit is None else place.bit)
    )
    if found is None:
        if text:
            raise ImportedFileError(f'"{cell}" is no bit: write 3, or 4-6')
        return {}
    if not kind.startswith(("uint", "int")):
        raise ImportedFileError(f"a bit of a {kind} means nothing")
    first, last = sorted((int(found[1]), int(found[2] or found[1])))
    return {"bit": first} if first == last else {"bits": f"{first}-{last}"}


def _registers(length: str, heading: str) -> int | None:
    """Find how many registers a row has; None if it does not say so."""
    if not length:
        return None
    found = re.fullmatch(r"(\d{1,3})(?:\.0)?\s*([a-z字节]*)\.?", length.lower())
    if found is None or not int(found[1]):
        raise ImportedFileError(f'"{length}" is no number of registers')
    number, what = int(found[1]), found[2] or heading.lower()
    if what.startswith("bit"):
        return max(1, number // 16)
    return max(1, number // 2) if "byte" in what or "字节" in what else number


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
