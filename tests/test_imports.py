"""The rooms of the house: imports flow one way, and third-party packages have owners."""

import ast
from pathlib import Path

import pytest

import jaxbeam

PACKAGE = Path(jaxbeam.__file__).parent
# Each module may import only modules above it.
ORDER = [
    "_types",
    "_status",
    "_results",
    "_kernel",
    "_band",
    "_blocks",
    "_linalg",
    "_beam",
    "_motion",
    "_spins",
    "_loads",
    "_basis",
    "_models.base",
    "_models.cartesian",
    "_models.modal",
    "_models.laws",
    "_models.elements",
    "_models.ancf",
    "_models.discrete",
    "_solvers.system",
    "_solvers.run",
    "_solvers.adjoint",
    "_solvers.steps",
    "_solvers.rodas",
    "_solvers.kvaerno",
    "_solvers.magnus",
    "_scene",
    "_course",
    "_following",
    "_integration",
    "_simulation",
    "_simulate",
    "_modes",
    "_indicators",
    "_questions",
    "_rungs",
    "_ahead",
    "_ladder",
    "_stable_step",
    "_stability",
    "_floquet",
    "_tongues",
    "_frequencies",
    "_cases",
    "_store",
    "_table",
    "_devices",
    "_sweep",
    "_ladder_sweep",
    "_southwell",
    "_experiments",
    "_free",
    "_fit",
    "plot",
    "__main__",
]
OWNERS = {
    "matplotlib": {"plot"},
    "xarray": {"_table"},
    "diffrax": {
        "_following",
        "_integration",
        "_simulation",
        "_simulate",
        "_questions",
        "_stable_step",
        "_experiments",
        *(name for name in ORDER if "_solvers." in name),
    },
    "optimistix": {"_integration", "_simulate", "_fit"},
    "optax": {"_fit"},
}
FILES = sorted(PACKAGE.rglob("*.py"))


def _name(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")


def _imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            found.add(node.module)
    return found


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_imports_flow_downward(path):
    name = _name(path)
    mine = {i.removeprefix("jaxbeam.") for i in _imports(path) if i.startswith("jaxbeam")}
    if name in ("__init__", "_models", "_solvers"):
        assert "plot" not in mine
        return
    if name == "__main__":
        mine.discard("jaxbeam")  # the one module that uses the package as its users do
    assert mine <= set(ORDER[: ORDER.index(name)])


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_third_party_packages_have_owners(path):
    for package, owners in OWNERS.items():
        if any(i.split(".")[0] == package for i in _imports(path)):
            assert _name(path) in owners


def test_files_stay_small():
    for path in FILES:
        assert len(path.read_text().splitlines()) <= 450, path
