"""What manuals call areas, functions, types, word orders and access, in English, German and Chinese; and numbers.

Numbers are as spreadsheets and manuals have them: 0.1, 0,1, 1/10, x10, 10^-1, 0x7FFF, 7FFFh.
"""

import re
import unicodedata
from collections.abc import Mapping
from decimal import Decimal
from typing import Final, Literal, NamedTuple

from gateway.config.importing.imported import ImportedFileError
from gateway.modbus.codes import Area
from gateway.profiles.point import Writing

Kind = Literal["uint", "int", "float", "string", "bcd", "bool"]

#: The area that a function reads or writes.
_AREA_OF_FUNCTION: Final[Mapping[int, Area]] = {
    **dict.fromkeys((1, 5, 15), Area.COILS),
    2: Area.DISCRETE,
    **dict.fromkeys((3, 6, 16, 22, 23), Area.HOLDING),
    4: Area.INPUT,
}
WRITING_FUNCTIONS: Final = frozenset({5, 6, 15, 16, 22, 23})

_AREA_WORDS: Final[Mapping[Area, str]] = {
    Area.DISCRETE: r"discrete|digital input|binary input|status input|input status|input bit|contact|\bdi\b|\b1x"
    r"|diskret|digitaleingang|离散|开关量输入",
    Area.COILS: r"\bcoils?\b|digital output|relay output|\bdo\b|\b0x\b|spule|digitalausgang|线圈|开关量输出",
    Area.HOLDING: r"holding|\bhr\b|\bhold\b|\b4x|halteregister|haltereg|保持",
    Area.INPUT: r"input|\bir\b|analog in|\b3x|eingangsregister|eingang|输入",
}
_ORDERS: Final[Mapping[str, str]] = {
    **dict.fromkeys(("abcd", "ab", "abcdefgh", "1234", "0123"), "none"),
    **dict.fromkeys(("cdab", "ghefcdab", "3412", "2301"), "words"),
    **dict.fromkeys(("badc", "ba", "badcfehg", "2143", "1032"), "bytes"),
    **dict.fromkeys(("dcba", "hgfedcba", "4321", "3210"), "both"),
}
#: Words for an order, whatever the heading; the first that fits counts.
_ORDER_WORDS: Final[Mapping[str, str]] = {
    r"word and byte|byte and word|words and bytes|word byte|wordbyte|^both$|bytes and words": "both",
    r"little endian byte swap|byte swapped little": "words",
    r"big endian byte swap|byte swapped big|mid big": "bytes",
    r"(low|least|lsw|lsr|lo|l).{0,14}first|lsw msw|low high|word swap|words|^word$|mid little|niederwertig": "words",
    r"(high|most|msw|msr|hi|h).{0,14}first|msw lsw|high low|big|^be$|motorola|network|^normal|höherwertig|大端": "none",
    r"byte swap|swapped bytes|bytes|^byte$": "bytes",
    r"^(no|none|not|false|0|nein|n|off|default|否)?$": "none",
}
_LITTLE: Final = r"little|^le$|intel|小端"
_YES: Final = rf"^(yes|true|1|ja|y|on|swap|swapped|reversed?|inverse|inverted|是|x)$|{_LITTLE}"

_READS: Final = r"^(r|ro|read|read only|readonly|r o|lesen|nur lesen|l|只读|读|no|false|0|nein|n|not writable|input)$"
_WRITES: Final = r"^(w|wo|write only|writeonly|w o|nur schreiben|s|只写|写)$"
_READS_AND_WRITES: Final = (
    r"^(rw|r w|wr|w r|read write|readwrite|read and write|read or write|r and w|rd wr|lesen schreiben|l s|ls"
    r"|schreiben|write|读写|可读写|读 写|yes|true|1|ja|y|writable|writeable|config|control)$"
)

_WIDTH: Final = re.compile(r"(?<!\d)(8|16|24|32|48|64)(?!\d)")
_BYTES: Final = re.compile(r"(?<!\d)(\d{1,2})\s*(?:bytes?|字节|b\b)")
_WORDS: Final = re.compile(r"(?<!\d)(\d{1,2})\s*(?:words?|registers?|regs?)\b")
_CHARACTERS: Final = re.compile(r"[\[(（.\s_*x]?\s*(\d{1,3})\s*(?:bytes?|chars?|zeichen)?[\])）]?\s*$")
#: Types by their words; the first that fits counts: the kind, and the bits if no number says so.
_TYPES: Final[tuple[tuple[str, Kind, int | None], ...]] = (
    (r"unsigned char|uchar|\bu(nsigned )?byte", "uint", 8),
    (r"signed char|\bs(igned )?byte", "int", 8),
    (
        r"string|\bstr\b|ascii|\btext\b|\bchars?\b|character|utf ?8|varchar|zeichen|字符|\bstr(?=\d)|\bchar(?=\d)",
        "string",
        None,
    ),
    (r"\bbcd", "bcd", None),
    (r"double|\bf(p|loat)? ?64|float ?64|lreal|real ?64", "float", 64),
    (r"float|\breal|single|ieee|\bfp? ?32|浮点|gleitkomma|\bt?_?flt\b", "float", None),
    (r"bit ?field|bit ?map|bit ?mask|bits|flags?|enum|status|\bbin\b|\bhex", "uint", None),
    (r"^(bool|boolean|bit|1 ?bit|coil|discrete|digital|switch|布尔|开关量)", "bool", None),
    (r"sunssf", "int", 16),
    (r"\bacc|\bcount$|epoch|unix|time ?stamp|ipaddr", "uint", None),
    (r"unsigned long long|\bulint|\blword|\bqword|\bu ?q ?word|ulonglong", "uint", 64),
    (r"long long|\blint|longlong", "int", 64),
    (r"\bs ?d?word|\bs ?qword", "int", None),
    (r"unsigned long|\bulong|\bu ?dword|\budint|\bdword|无符号长|双字", "uint", 32),
    (r"\blong|\bdint|长整", "int", 32),
    (r"\busint", "uint", 8),
    (r"\bsint(?! ?\d)", "int", 8),
    (
        (
            r"unsigned|\buns\b|\bu ?(int|short|word|integer)|\bu ?\d|int ?\d+ ?u|uint|ushort|\bword|无符"
            r"|vorzeichenlos|ohne vorzeichen"
        ),
        "uint",
        None,
    ),
    (r"signed|int ?\d+ ?s?|\bs ?\d|\bi ?\d|integer|\bint\b|short|\bs ?int|有符号|mit vorzeichen|整", "int", None),
    (r"\bbyte|字节", "uint", 8),
    (r"^\d+ ?bits?$|^字$", "uint", None),
)
#: Words whose own width is not 16 bits.
_WIDTH_WORDS: Final[tuple[tuple[str, int], ...]] = ((r"dword|double word|双", 32), (r"qword|lword|quad", 64))
_LARGEST_EXPONENT: Final = 30
_PLAIN: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d{1,2})?", re.ASCII)
_HEX: Final = re.compile(r"([+-]?)(?:0x([0-9a-f]{1,16})|([0-9a-f]{1,16})h)")
_POWER: Final = re.compile(r"10\s*(?:\^|\*\*|e)\s*\(?([+-]?\d{1,2})\)?")
_SIGNS: Final = str.maketrans({"−": "-", "–": "-", "×": "x", "÷": "/", "⁻": "-", "’": "'", "\N{NO-BREAK SPACE}": " "})
_GROUPS: Final = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d+)?")


class TypeWords(NamedTuple):
    """What a type says of itself: bits, characters and word order may be missing."""

    kind: Kind
    bits: int | None = None
    characters: int | None = None
    swap: str | None = None


def area_of(cell: str) -> Area | None:
    """Find the area that a cell names, by its words or with `FC3` by a function; None if it names none."""
    text = simple(cell)
    found = re.fullmatch(r"(?:fc|fn|function|func|f) ?0?([1-4])", text)
    if found:
        return _AREA_OF_FUNCTION[int(found[1])]
    return next((area for area, words in _AREA_WORDS.items() if re.search(words, text)), None)


def functions_of(cell: str) -> frozenset[int]:
    """Find the functions that a cell lists: 3, 03/06/16, FC04, 0x10, 03H/10H; none if there is something else in it."""
    text = re.sub(r"\b(fc|fn|func|function|code|read|write|r|w|and|or|hex)\b|[^\w]+", " ", _lower(cell)).strip()
    text = re.sub(r"\bfc?(?=\d)", "", text)
    found: set[int] = set()
    for word in text.split():
        number = re.fullmatch(r"(?:0x([0-9a-f]{1,2})|([0-9a-f]{1,2})h|(\d{1,2}))", word)
        if number is None:
            return frozenset()
        value = int(number[3]) if number[3] else int(number[1] or number[2], 16)
        # 10 without an h is 16 too: no device has a function 10.
        found.add(16 if value == 10 else 15 if word in ("0f", "0fh") else value)
    return frozenset(found) if found <= _AREA_OF_FUNCTION.keys() else frozenset()


def area_of_functions(functions: frozenset[int]) -> Area | None:
    """Find the area of functions; None if they are of several, or there are none."""
    areas = {_AREA_OF_FUNCTION[each] for each in functions}
    return next(iter(areas)) if len(areas) == 1 else None


def type_of(cell: str) -> TypeWords | None:
    """Find out what type a cell names; None if it names none."""
    text = simple(cell)
    swap = _letters(text) or ("words" if re.search(r"swap|\bre?v?(erse)?$|inverse|\bcdab|lsw first", text) else None)
    text = re.sub(r"\b(be|le|abcd|cdab|badc|dcba|swapped|swap)\b", " ", text).strip()
    for words, kind, bits in _TYPES:
        if re.search(words, text):
            if kind == "string":
                found = _CHARACTERS.search(text)
                return TypeWords(kind, None, int(found[1]) if found and "utf" not in text else None, swap)
            return TypeWords(kind, _bits(text) or bits, None, swap)
    return None


def swap_of(cell: str, heading: str) -> str | None:
    """Find the swap that a cell names, in a column with this heading; None if it names none."""
    text, said = simple(cell), simple(heading)
    named = _letters(text) or next((swap for words, swap in _ORDER_WORDS.items() if re.search(words, text)), None)
    if named is not None or not re.search(_YES, text):
        return named
    of_bytes, of_words = re.search(r"byte|字节", said), re.search(r"word|register|wort|字序", said)
    if re.search(_LITTLE, text):
        return "words" if of_words and not of_bytes else "both"
    return "bytes" if of_bytes and not of_words else "words"


def access_of(cell: str) -> Writing | None:
    """Find out whether a cell says that a point can be written; None if it says nothing."""
    text = simple(cell)
    for words, writing in ((_READS_AND_WRITES, "yes"), (_READS, "no"), (_WRITES, "only")):
        if re.search(words, text):
            return writing  # type: ignore[return-value]
    return None


def _bits(text: str) -> int | None:
    """Find how many bits a type has by the numbers in its name."""
    for pattern, factor in ((_BYTES, 8), (_WORDS, 16), (_WIDTH, 1)):
        found = pattern.search(text)
        if found:
            return int(found[1]) * factor
    return next((bits for words, bits in _WIDTH_WORDS if re.search(words, text)), None)


def _letters(text: str) -> str | None:
    """Find an order that is written in letters or digits: ABCD, CD AB, 3-4-1-2."""
    joined = text.replace(" ", "")
    if joined in _ORDERS:
        return _ORDERS[joined]
    return next((_ORDERS[word] for word in text.split() if word in _ORDERS and word.isalpha()), None)


def _lower(cell: str) -> str:
    return unicodedata.normalize("NFKC", cell).lower()


def simple(cell: str) -> str:
    """Write a cell in lower case, with single spaces for all that is no letter and no digit."""
    return re.sub(r"[\W_]+", " ", _lower(cell)).strip()


def number_of(cell: str, *, has_decimal_comma: bool = False) -> Decimal:
    """Parse a number."""
    text = _lower(cell).translate(_SIGNS).strip("' ")
    in_hex = _HEX.fullmatch(text)
    if in_hex:
        return Decimal(int(f"{in_hex[1]}{in_hex[2] or in_hex[3]}", 16))
    if "," in text:
        is_grouped = not has_decimal_comma and _GROUPS.fullmatch(text) is not None
        text = text.replace(",", "") if is_grouped or "." in text else text.replace(",", ".")
    if not _PLAIN.fullmatch(text):
        raise ImportedFileError(f'"{cell}" is no number')
    return Decimal(text)


def factor_of(cell: str, *, has_decimal_comma: bool = False) -> Decimal:
    """Parse a factor: a number, 1/10, x 0.1, /10, 10^-1; a unit may stand behind it."""
    text = _lower(cell).translate(_SIGNS).strip("' ")
    text = re.sub(r"^(?:x|\*|mal|times)\s*", "", text)
    power, parts = _POWER.fullmatch(text), [part.strip() for part in re.split(r"[/:]", text)]
    if power:
        factor = Decimal(10) ** int(power[1])
    elif len(parts) == 2 and parts[1]:
        below = number_of(parts[1], has_decimal_comma=has_decimal_comma)
        above = number_of(parts[0], has_decimal_comma=has_decimal_comma) if parts[0] else Decimal(1)
        factor = above / below if below else Decimal(0)
    else:
        factor = number_of(text, has_decimal_comma=has_decimal_comma)
    if not factor or abs(factor.adjusted()) > _LARGEST_EXPONENT:
        raise ImportedFileError(f'"{cell}" is no factor')
    return factor


def scaled_unit(unit: str) -> tuple[Decimal, str]:
    """Split a unit that has a factor: 0.1V is 0.1 and V, 0.01 is one without a unit; 1/min is a unit."""
    found = re.fullmatch(r"[x×*]?\s*(\d[\d.,]*)\s*((?:[^\d\s/.,)(^~-].*)?)", unit)
    if found is None:
        return Decimal(1), unit
    try:
        return factor_of(found[1]), found[2].strip()
    except ImportedFileError:
        return Decimal(1), unit
