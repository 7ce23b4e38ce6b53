"""Which files of beams and blades there are, told by what is in them, and which are read."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Self

READ = (
    "tables of named columns (CSV), blade files of ElastoDyn, section files and main files of "
    "BModes, primary files and blade files of BeamDyn, HAWC2, windIO and VABS"
)


_NAME = r"^[^#\n]*(?<!\S)(?:{})(?!\w)"  # a word of a line


class Format(NamedTuple):
    """A format: what its files are called, who reads them if anybody does, and texts all of which
    are in them."""

    title: str
    reader: str | None
    texts: tuple[re.Pattern[str], ...]

    @classmethod
    def of(cls, title: str, *texts: str, words: str = "", reader: str | None = None) -> Self:
        """`words` are alone in lines, or behind a value, blanks between them; `texts` as they
        are."""
        every = [*texts, *map(_NAME.format, words.split())]
        return cls(title, reader, tuple(re.compile(text, re.M | re.I) for text in every))


FORMATS = (
    Format.of("an Excel workbook (save it as CSV)", r"\APK\x03\x04"),
    Format.of("a BeamDyn blade file", words="station_total", reader="read_beamdyn"),
    Format.of("a BeamDyn primary file", words="kp_total", reader="read_beamdyn"),
    Format.of("an ElastoDyn tower file", words="HtFract TMassDen|TwFAStif"),
    Format.of("an ElastoDyn primary file", r"BldFile\W?1", words="TipRad"),
    Format.of("an AeroDyn blade file", words="BlSpn BlChord"),
    Format.of(
        "a HAWC2 htc file",
        r"^\s*begin\s+(new_htc_structure|main_body|c2_def|timoschenko_input)",
        reader="read_hawc2",
    ),
    Format.of("a HAWC2 st file", r"^\s*#\s*\d+", r"^\s*\$\s*\d+\s+\d+", reader="read_hawc2"),
    Format.of(
        "a windIO YAML file",
        r"^['\"]?components['\"]?\s*:",
        r"^\s+['\"]?blade['\"]?\s*:",
        reader="read_windio",
    ),
    Format.of(
        "a VABS .K file",
        r"the 6x6 mass matrix|^\s*(timoshenko|classical) stiffness matrix",
        reader="read_vabs",
    ),
    Format.of("an ElastoDyn blade file", words="BlFract NBlInpSt", reader="read_elastodyn"),
    Format.of("a BModes main file", words="sec_props_file", reader="read_bmodes"),
    Format.of("a BModes section file", words="n_secs", reader="read_bmodes"),
)


def format_of(lines: Sequence[str]) -> Format | None:
    """The format of a file, if it is one of those that are known by name."""
    text = "\n".join(lines)
    for each in FORMATS:
        if all(re.search(part, text) for part in each.texts):
            return each
    return None


def refuse_other(path: Path, lines: Sequence[str], reader: str) -> None:
    """Raise where a file is of a format that this reader does not read."""
    found = format_of(lines)
    if found is None or found.reader == reader:
        return
    if found.reader:
        raise ValueError(f"{path} is {found.title}: take {found.reader}, or read_blade")
    raise ValueError(f"{path} is {found.title}, which is not read; known are {READ}")


def no_format(path: Path, why: str) -> ValueError:
    """The error for a file of no known kind."""
    return ValueError(f"{path} is of no known kind, {why}; known are {READ}")
