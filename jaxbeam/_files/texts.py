"""Lines, entries and numbers of files as spreadsheets, editors and Fortran write them."""

import math
import os
import re
from pathlib import Path

FilePath = str | os.PathLike[str]
# A number of Fortran: 1.0D+10 and 1.0+10 as well as 1e10; without a letter only with a decimal
# point, since 10-12 is rather a date.
_NUMBER = re.compile(r"([+-]?)(\d+\.?\d*|\.\d+)(?:[eEdDqQ]([+-]?\d+)|([+-]\d+))?", re.ASCII)
_ENTRY = re.compile(r"""('(?:[^']|'')*'|"(?:[^"]|"")*")(?![^\s,/!])|[^\s,!]+""")
_REPEATED = re.compile(r"(\d{1,3})\*(.*)", re.ASCII)


def read_lines(path: Path) -> list[str]:
    """Lines of a text file in UTF-8, in UTF-16 with a byte order mark, or else in Windows-1252."""
    data = path.read_bytes()
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", "replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", "replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def entries(line: str) -> list[str]:
    """Entries of a line as list-directed input of Fortran has them.

    Blanks and commas part them, an entry between two commas is empty, 3*0.0 is three entries, a
    slash ends the line (but 1/2 is one entry, and no number), and so does an exclamation mark.
    Quotes are taken off.
    """
    found: list[str] = []
    rest, empty = line.lstrip(), True
    while rest and rest[0] not in "/!":
        if rest[0] == ",":
            found += [""] if empty else []
            rest, empty = rest[1:].lstrip(), True
            continue
        match = _ENTRY.match(rest)
        assert match is not None
        text = match[0]
        rest, empty = rest[len(text) :].lstrip(), False
        if match[1]:
            found.append(text[1:-1])
            continue
        rest = "" if text.endswith("/") else rest
        text = text.removesuffix("/")
        repeated = _REPEATED.fullmatch(text)
        found += int(repeated[1]) * [repeated[2]] if repeated else [text]
    return found


def mistake(path: Path, line: int, column: str | None, what: str) -> ValueError:
    where = f"{path}, line {line}" + (f", column {column}" if column else "")
    return ValueError(f"{where}: {what}")


def number_in(path: Path, line: int, column: str, text: str, zero: bool | None = None) -> float:
    """A finite number of an entry, checked: positive, with `zero` not negative, with None of any
    sign."""
    try:
        number = as_number(text)
    except ValueError:
        raise mistake(path, line, column, f"not a number, {text!r}") from None
    fine = math.isfinite(number) and (zero is None or number > 0 or (zero and number == 0))
    if not fine:
        rule = {None: "", False: " and > 0", True: " and >= 0"}[zero]
        raise mistake(path, line, column, f"must be finite{rule}, got {text}")
    return number or 0.0  # no negative zero


def as_number(text: str) -> float:
    """A number in the notations of Fortran and spreadsheets, NaN and infinity included; raises
    `ValueError` for others."""
    if match := _NUMBER.fullmatch(text):
        sign, digits, exponent, bare = match.groups()
        if bare is None or "." in digits:
            return float(f"{sign}{digits}e{exponent or bare or 0}")
    elif text.lstrip("+-").lower() in ("nan", "inf", "infinity"):
        return float(text)
    raise ValueError(text)


def is_number(text: str, value: float | None = None) -> bool:
    """Whether a text is a number, or is this one."""
    try:
        number = as_number(text)
    except ValueError:
        return False
    return value is None or number == value
