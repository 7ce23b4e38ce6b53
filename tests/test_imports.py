"""The rooms of the house: imports flow one way, and third-party packages have owners. What tests
import of one another: helpers alone, and the references nothing of the package."""

import ast
import collections
import contextlib
import graphlib
from pathlib import Path

import pytest

from tests.package import MODULES, ROOMS

pytestmark = pytest.mark.release
OWNERS = {  # rooms or modules that may import a package
    "matplotlib": {"plot"},
    "xarray": {"_sweeps.table"},
    "diffrax": {"_solvers", "_simulation", "_fitting.experiments"},
    "optimistix": {"_simulation", "_fitting.fit"},
    "optax": {"_fitting.fit"},
}
TESTS = Path(__file__).parent


def _imports(name: str) -> set[str]:
    return {module for module, _ in _imported(MODULES[name].read_text())}


def _imported(text: str) -> set[tuple[str, str | None]]:
    """Modules that a text imports, each with the name that is taken from it, if one is."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {(alias.name, None) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            found |= {(node.module, alias.name) for alias in node.names}
    return found


def _imported_by_test(path: Path) -> set[str]:
    """The same of a file among the tests, and of the programs that it has as texts; `from a import
    b` as a.b, which may be a module."""
    tree = ast.parse(path.read_text())
    texts = [path.read_text()]
    texts += [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and "import" in node.value
    ]
    found = set()
    for text in texts:
        with contextlib.suppress(SyntaxError):  # words, most often
            found |= {f"{module}.{name}" if name else module for module, name in _imported(text)}
    return found


def _own(name: str) -> set[str]:
    """What a module imports from the package."""
    return {i.removeprefix("jaxbeam.") for i in _imports(name) if i.startswith("jaxbeam.")}


def _room(name: str) -> str:
    """The room that a module is in."""
    parts = name.removesuffix(".__init__").split(".")
    return ".".join(parts[:2]) if parts[0] == "_models" else parts[0]


def test_every_room_has_its_place():
    """In the table of the page inside."""
    assert {_room(name) for name in MODULES} == {"__init__", "_models", *ROOMS}
    assert len(set(ROOMS)) == len(ROOMS)


@pytest.mark.parametrize("name", MODULES)
def test_imports_flow_downward(name):
    if name == "__init__":
        return
    for imported in _own(name):
        assert ROOMS.index(_room(imported)) <= ROOMS.index(_room(name)), imported
    # The command alone uses the package as its users do.
    assert "jaxbeam" not in _imports(name) or _room(name) in ("_command", "__main__")


def test_modules_import_one_another_without_circles():
    graphlib.TopologicalSorter({name: _own(name) for name in MODULES}).prepare()


@pytest.mark.parametrize("name", MODULES)
def test_third_party_packages_have_owners(name):
    packages = {i.split(".")[0] for i in _imports(name)}
    for package, owners in OWNERS.items():
        if package in packages:
            assert {name, name.split(".")[0]} & owners, package


@pytest.mark.parametrize("name", MODULES)
def test_files_and_functions_stay_small(name):
    text = MODULES[name].read_text()
    assert len(text.splitlines()) <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            said = node.body[0] if ast.get_docstring(node) else None
            told = said.end_lineno - said.lineno + 1 if said else 0
            assert node.end_lineno - node.lineno + 1 - told <= 60, node.name


def test_a_class_name_is_that_of_one_class():
    nodes = [node for path in MODULES.values() for node in ast.walk(ast.parse(path.read_text()))]
    names = collections.Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    assert [name for name, count in names.items() if count > 1] == []


def test_references_know_nothing_of_the_package():
    """Nor do what they import among the tests."""
    for path in (TESTS / "references").glob("*.py"):
        for module in _imported_by_test(path):
            root, *rest = module.split(".")
            assert root != "jaxbeam", path.name
            assert root != "tests" or rest[0] == "references", path.name


def test_test_modules_import_no_other():
    """What they share is in a module beside them."""
    for path in TESTS.rglob("*.py"):
        for module in _imported_by_test(path):
            root, *rest = module.split(".")
            assert root != "tests" or not any(part.startswith("test_") for part in rest), path
