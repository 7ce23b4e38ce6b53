"""The modules of the package, as files."""

from pathlib import Path

import jaxbeam

PACKAGE = Path(jaxbeam.__file__).parent
# Public modules of names by subject.
SUBJECTS = ["models", "motions", "solvers", "results", "fitting", "ladder", "blades", "programs"]
MODULES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
