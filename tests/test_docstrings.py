"""Docstrings: they name all arguments, say what is raised, and begin with a sentence of their own.

They are read, not imported, so that these tests wait neither for diffrax nor for matplotlib.
"""

import ast
import functools
import inspect
import re
from collections.abc import Iterator
from typing import NamedTuple

import jaxbeam
from tests.package import MODULES, SUBJECTS

# Arguments that need not be named, or None for all, and why.
UNNAMED = {
    "Status": (None, "an enum: `Status(code)` is all that there is to call"),
    "BladeFormat": (None, "an enum: its members are all that there is"),
    "Direction": (None, "an enum: `Direction(code)` is all that there is to call"),
    "Simulation": ({"is_partial"}, "set by `partial`"),
    "Fit": ({"free", "z", "scale", "known_noise"}, "what `partial` and `interval` go by"),
    "Cases": ({"of_list"}, "tells `points` from `grid`"),
}
# Functions, and classes with a constructor of their own, that raise nothing themselves, and why.
NEVER_RAISES = {
    "State": "takes arrays as they are; `simulate` checks them",
    "SteadyStart": "made by `steady_start`",
    "Scene": "made by `simulate`, of what is checked",
}
# What users hold in their hands and ask for more: of these, methods too.
ASKED = {
    "Table", "Cases", "Modes", "Campbell", "Simulation", "Steady", "Fit", "Answer",
    "Choice", "BladeTable",
}  # fmt: skip
# Words with which a first sentence begins that hangs on the name of what it is said of.
FRAGMENTS = {
    "of",
    "those",
    "that",
    "these",
    "it",
    "as",
    "its",
    "they",
    "this",
    "such",
    "same",
    "by",
    "from",
    "with",
    "without",
    "in",
    "at",
    "to",
    "for",
}
# Of a function or class too: it is said as a noun, or as a verb with its object.
ASKS = {"what", "which", "so", "have"}  # fmt: skip
CONSTRUCTORS = "__init__", "__check_init__", "__post_init__"

Documented = ast.FunctionDef | ast.ClassDef


class Found(NamedTuple):
    """A function or class, and the module that it is in."""

    module: str
    node: Documented


@functools.cache
def tree(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text())


@functools.cache
def definitions(module: str) -> dict[str, Found]:
    """Functions and classes by name, also those that are imported from elsewhere in the package."""
    found = {}
    for node in tree(module).body:
        if isinstance(node, Documented):
            found[node.name] = Found(module, node)
        elif isinstance(node, ast.ImportFrom) and node.module.startswith("jaxbeam."):
            other = node.module.removeprefix("jaxbeam.")
            theirs = tree(other).body if other in MODULES else []
            wanted = {each.name for each in node.names}
            every = [n for n in theirs if isinstance(n, Documented) and n.name in wanted]
            found |= {n.name: Found(other, n) for n in every}
    return found


@functools.cache
def public() -> dict[str, Found]:
    """What users call, by the name by which they do."""
    found = {}
    everyday = inspect.getsource(jaxbeam)
    for room, name in re.findall(r"from jaxbeam\.(\S+) import (\w+) as", everyday):
        found[name] = definitions(room)[name]
    for subject in SUBJECTS:
        found |= definitions(subject)
    found = {name: each for name, each in found.items() if not name.startswith("_")}
    figures = {name: each for name, each in definitions("plot").items() if each.module == "plot"}
    return found | {f"plot.{name}": each for name, each in figures.items() if name[0] != "_"}


def lineage(found: Found) -> Iterator[Found]:
    """A class and those of the package that it derives from."""
    yield found
    for base in found.node.bases:
        name = ast.unparse(base).split("[")[0]
        if name in definitions(found.module):
            yield from lineage(definitions(found.module)[name])


def methods(found: Found) -> dict[str, ast.FunctionDef]:
    """What a class has of its own, and from others."""
    every: dict[str, ast.FunctionDef] = {}
    for each in lineage(found):
        own = {n.name: n for n in each.node.body if isinstance(n, ast.FunctionDef)}
        every = own | every
    return every


def arguments(found: Found) -> list[str]:
    """What a function takes, or the constructor of a class, which may be made of its fields."""
    node = found.node
    if isinstance(node, ast.ClassDef):
        init = methods(found).get("__init__")
        if init is None:
            return [field for each in reversed([*lineage(found)]) for field in fields(each.node)]
        node = init
    given = node.args
    extra = [a for a in (given.vararg, given.kwarg) if a is not None]
    names = [a.arg for a in [*given.posonlyargs, *given.args, *given.kwonlyargs, *extra]]
    return [name for name in names if name not in ("self", "cls")]


def fields(node: ast.ClassDef) -> list[str]:
    """Fields of a class that its constructor takes of its users."""
    own = [n for n in node.body if isinstance(n, ast.AnnAssign)]
    named = [n for n in own if not re.search("ClassVar|AbstractVar", ast.unparse(n.annotation))]
    return [name for n in named if not (name := ast.unparse(n.target)).startswith("_")]


def told(found: Found) -> str:
    """All that is said of a function, or of a class and its constructor."""
    own = [n for n in found.node.body if getattr(n, "name", "") == "__init__"]
    return "\n".join(ast.get_docstring(node) or "" for node in [found.node, *own])


def checks(found: Found) -> bool:
    """Whether it is a function, or a class with a constructor that somebody wrote."""
    is_class = isinstance(found.node, ast.ClassDef)
    return not is_class or any(name in CONSTRUCTORS for name in methods(found))


def names(argument: str, text: str) -> bool:
    """Whether an argument is in back quotes, or in the first column of a table."""
    return bool(re.search(rf"`\**{argument}\b|^ *\| *{argument} *\|", text, re.M))


def test_public_docstrings_name_all_arguments():
    unnamed = {}
    for name, each in public().items():
        exempt, _ = UNNAMED.get(name, (set(), ""))
        if exempt is not None:
            given = [a for a in arguments(each) if a not in exempt]
            unnamed[name] = [a for a in given if not names(a, told(each))]
    assert {name: those for name, those in unnamed.items() if those} == {}
    # What is asked of them is found: a function, a constructor, fields of its own and from bases.
    assert arguments(public()["crossing"])[:3] == ["model", "rotor", "bracket"]
    assert "hub_radius" in arguments(public()["Rotor"])
    assert arguments(public()["VonKarman"])[:3] == ["n_stretch", "n_in_plane", "n_flap"]


def test_public_docstrings_say_what_is_raised():
    silent = [
        name for name, each in public().items()
        if checks(each) and not re.search(r"^ *Raises\b", told(each), re.M)
    ]  # fmt: skip
    assert sorted({*silent} - NEVER_RAISES.keys()) == []


def test_methods_of_results_say_what_they_take_and_raise():
    silent = []
    for name in sorted(ASKED):
        each = public()[name]
        bases = [base.id for base in each.node.bases if isinstance(base, ast.Name)]
        known = definitions(each.module)
        nodes = [each.node, *(known[base].node for base in bases if base in known)]
        all_of_them = [n for node in nodes for n in node.body]
        own = [n for n in all_of_them if isinstance(n, ast.FunctionDef) and n.name[0] != "_"]
        for node in own:
            text = ast.get_docstring(node) or ""
            unnamed = [a for a in arguments(Found(each.module, node)) if not names(a, text)]
            raises = any(isinstance(part, ast.Raise) for part in ast.walk(node))
            if unnamed or not text or (raises and not re.search(r"^ *Raises\b", text, re.M)):
                silent.append((name, node.name, unnamed))
    assert silent == []


def test_exceptions_are_of_what_is_there():
    assert {*UNNAMED, *NEVER_RAISES, *ASKED} <= public().keys()
    for name, (exempt, _) in UNNAMED.items():
        assert (exempt or set()) <= {*arguments(public()[name])}


def test_docstrings_begin_with_a_sentence_of_their_own():
    wrong = []
    for module in MODULES:
        for node in ast.walk(tree(module)):
            if not isinstance(node, Documented | ast.Module):
                continue
            text = ast.get_docstring(node)
            if text is None:
                continue
            first, *rest = text.split(None, 2)
            two = [first, *rest[:1]]
            fragment = first.lower() in FRAGMENTS or two in (["The", "same"], ["One", "of"])
            # A whole sentence or phrase; a formula may follow.
            fragment |= isinstance(node, Documented) and first.lower() in ASKS
            fragment |= not text.split("\n\n")[0].rstrip().endswith((".", ":", ",", "with"))
            # A capital, or a symbol: a letter, or what has digits or signs within.
            begins = first[0].isupper() or not first.isalpha() or len(first) == 1 or first == "int"
            if fragment or not begins:
                wrong.append((module, getattr(node, "name", ""), text.splitlines()[0]))
    assert wrong == []
