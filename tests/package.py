"""The modules of the package, as files, and its rooms, as its page has them."""

import re
from pathlib import Path

import jaxbeam

PACKAGE = Path(jaxbeam.__file__).parent
# Public modules of names by subject.
SUBJECTS = [
    "models", "papers", "motions", "solvers", "results", "fitting", "ladder", "blades", "programs",
]  # fmt: skip
MODULES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
# Rooms, folders or single modules: each may import from those above it alone.
_PAGE = Path(__file__).parents[1] / "jaxbeam" / "README.md"
_TABLE = _PAGE.read_text().split("| room | subject |")[1].split("\n\n")[0]
_ROWS = [line.split(" | ")[0] for line in _TABLE.splitlines()[2:]]
ROOMS = [
    name.replace("/", ".") for row in _ROWS for name in re.findall(r"`([\w/]+?)(?:/|\.py)?`", row)
]
