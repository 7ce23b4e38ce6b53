"""Programs that are kept between processes: never a stale one, never an error for want of one."""

import json
import os
import stat
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache

import jaxbeam as jb
from jaxbeam.__main__ import main
from jaxbeam._modes.modes import find
from jaxbeam._programs import folder as folders
from jaxbeam._programs import identity, traced
from jaxbeam._programs.program import Program
from jaxbeam._programs.structure import Encoder, NotKept, decoded
from tests.beams import README_ROTOR as ROTOR

pytest.importorskip("flatbuffers")
SETTINGS = (
    "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)  # fmt: skip
SMALL = jb.Hybrid(0, 1, 0)
SCENE = """
[model]
name = "Hybrid"
n_stretch = 0
n_in_plane = 1
n_flap = 0
[frequencies]
in_plane = 1
[sweep]
angular_speed = [1.0, 2.0]
[beam]
length = 8.0
mass_per_length = 0.2
axial_stiffness = 5e6
in_plane_bending_stiffness = 566.0
flap_bending_stiffness = 566.0
[rotor]
hub_radius = 0.5
"""


@pytest.fixture
def keep(monkeypatch):
    """`jb.keep`, until the end of the test."""
    before = {name: getattr(jax.config, name) for name in SETTINGS}
    monkeypatch.setattr(folders, "_folder", None)
    monkeypatch.setattr(folders, "_warned", False)
    yield jb.keep
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()


@pytest.fixture
def counted(monkeypatch):
    """How often programs were traced for the folder."""
    made = []
    exported = traced._exported
    monkeypatch.setattr(traced, "_exported", lambda *a: (made.append(a), exported(*a))[1])
    return made


def doubled(x, factor):
    """A program of this package, as far as names go."""
    return {"found": factor * x, "by": factor}


def as_ours(function):
    return Program(function, identity=lambda: ["tests", function.__qualname__])


def forget(*programs):
    """As another process would know of nothing."""
    for program in programs:
        program._traces._found.clear()


def files(folder):
    return sorted(path for path in (folder / "traced").iterdir() if path.name[0] != ".")


def test_a_program_is_kept_and_taken_again(keep, counted, tmp_path):
    assert keep(tmp_path / "a") == tmp_path / "a"
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o700
    program = as_ours(doubled)
    for x, factor, most in (
        (jnp.arange(3.0), 2, 1), (jnp.arange(3.0) + 1, 2, 1), (jnp.arange(4.0), 2, 2),
        (jnp.arange(3), 2, 3), (jnp.asarray(2.0), 2, 4), (jnp.arange(3.0), 2.0, 5),
        (jnp.arange(3.0), True, 6), (jnp.arange(1.0, 4.0), 2, 6),
    ):  # fmt: skip
        forget(program)
        found = program(x, factor)
        np.testing.assert_array_equal(found["found"], factor * x)
        assert found["found"].dtype == (factor * x).dtype
        assert (type(found["by"]), found["by"]) == (type(factor), factor)
        assert len(counted) == len(files(tmp_path / "a")) == most


def test_modes_are_those_that_were_not_kept(keep, counted, tmp_path):
    """All of a result, its theory too, which is that of the caller."""
    plain = jb.modes(SMALL, ROTOR, 2.0, 1)
    keep(tmp_path)
    for speed in (2.0, 2.0, 1.0):
        forget(find)
        kept = jb.modes(SMALL, ROTOR, speed, 1)
        if speed == 2.0:
            assert eqx.tree_equal(kept, plain)
        assert repr(kept.model) == repr(plain.model)
        assert kept.model.basis is SMALL.basis
    assert len(counted) == len(files(tmp_path)) == 1
    assert jb.modes(SMALL, ROTOR, 1.0, 1).frequency < plain.frequency


def test_what_the_key_holds(keep, counted, tmp_path, monkeypatch):
    """Other sources, versions and settings are other programs."""
    keep(tmp_path)
    program, x = as_ours(doubled), jnp.arange(3.0)

    def makes_anew():
        before = len(counted)
        forget(program)
        program(x, 2)
        return len(counted) > before

    assert makes_anew()
    assert not makes_anew()
    real = identity.sources()
    with monkeypatch.context() as patched:
        patched.setattr(traced, "sources_stayed", lambda: True)
        patched.setattr(identity, "sources", lambda: ("edited", real[1]))
        assert makes_anew()
        assert not makes_anew()
    versions = identity.versions()
    for name in (*versions, "another"):
        with monkeypatch.context() as patched:
            patched.setattr(identity, "versions", lambda name=name: {**versions, name: "0.0.0"})
            assert makes_anew(), name
    with monkeypatch.context() as patched:
        patched.setenv("EQX_ON_ERROR", "nan")
        assert makes_anew()
    with jax.numpy_dtype_promotion("strict"):
        assert makes_anew()
    assert not makes_anew()


def test_sources_that_changed_under_the_process(keep, tmp_path, monkeypatch):
    """What runs may be neither what was there nor what is: nothing is kept of it."""
    keep(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(traced, "sources_stayed", lambda: False)
        assert as_ours(doubled)(jnp.arange(3.0), 2)["by"] == 2
    assert files(tmp_path) == []
    identity.sources.cache_clear()
    with monkeypatch.context() as patched:
        patched.setattr(identity, "_STARTED", 0)
        with pytest.raises(NotKept, match="changed since it was imported"):
            identity.sources()
        assert as_ours(doubled)(jnp.arange(3.0), 2)["by"] == 2
    assert files(tmp_path) == []
    as_ours(doubled)(jnp.arange(3.0), 2)
    assert len(files(tmp_path)) == 1


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda said: said[:-1], lambda said: b"", lambda said: said[:40], lambda said: said + b"x",
        lambda said: said[:200] + bytes([said[200] ^ 1]) + said[201:],
    ],
    ids=["short", "empty", "head", "long", "flipped"],
)  # fmt: skip
def test_a_damaged_file_is_made_anew(keep, counted, tmp_path, spoilt):
    keep(tmp_path)
    program, x = as_ours(doubled), jnp.arange(3.0)
    program(x, 2)
    [file] = files(tmp_path)
    whole = file.read_bytes()
    file.write_bytes(spoilt(whole))
    forget(program)
    with pytest.warns(UserWarning, match="is damaged"):
        np.testing.assert_array_equal(program(x, 2)["found"], 2 * x)
    assert len(counted) == 2
    assert file.read_bytes()[:26] == whole[:26]
    forget(program)
    program(x, 2)
    assert len(counted) == 2


def test_a_folder_that_cannot_be_written(keep, counted, tmp_path, monkeypatch):
    """One warning in a process, and the same numbers."""
    keep(tmp_path)
    program, x = as_ours(doubled), jnp.arange(3.0)

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", full)
        with pytest.warns(UserWarning, match="cannot be written to .*No space left"):
            program(x, 2)
        np.testing.assert_array_equal(program(x + 1, 2)["found"], 2 * x + 2)
        program(jnp.arange(4.0), 2)  # and no other warning
        keep(tmp_path)
        assert jax.config.jax_persistent_cache_min_compile_time_secs > 1e6  # nor one of JAX
    assert files(tmp_path) == []
    assert [path for path in (tmp_path / "traced").iterdir() if path.suffix == ".part"] == []


def test_a_folder_that_is_none(keep, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.warns(UserWarning, match="file cannot be made"):
        assert keep(tmp_path / "file") is None
    assert folders.folder() is None
    with pytest.raises(TypeError, match="folder must be a path, got int"):
        keep(3)


def test_a_folder_of_others(keep, tmp_path, monkeypatch):
    """They could put programs there."""
    for mode in (0o770, 0o707):
        (tmp_path / "a").mkdir(exist_ok=True)
        (tmp_path / "a").chmod(mode)
        with pytest.raises(ValueError, match="chmod go-w"):
            keep(tmp_path / "a")
    (tmp_path / "a").chmod(0o755)
    assert keep(tmp_path / "a")
    (tmp_path / "a" / "traced").chmod(0o777)
    with pytest.raises(ValueError, match=r"chmod go-w .*traced"):
        keep(tmp_path / "a")
    user = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: user + 1)
    with pytest.raises(ValueError, match=f"belongs to user {user}"):
        keep(tmp_path / "b")


def test_which_folder(keep, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    assert keep() is None  # as tests/conftest.py says
    monkeypatch.setenv("JAXBEAM_KEEP", str(tmp_path / "named"))
    assert keep() == tmp_path / "named"
    monkeypatch.delenv("JAXBEAM_KEEP")
    assert keep() == tmp_path / "caches" / "jaxbeam"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # is to be ignored
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert keep() == tmp_path / "home" / ".cache" / "jaxbeam"


def test_without_flatbuffers(keep, counted, tmp_path, monkeypatch):
    """Compiled programs are kept, traced ones are not."""
    find_spec = folders.importlib.util.find_spec
    monkeypatch.setattr(
        folders.importlib.util, "find_spec",
        lambda name: None if name == "flatbuffers" else find_spec(name),
    )  # fmt: skip
    with pytest.warns(UserWarning, match=r"pip install .jaxbeam\[keep\]"):
        keep(tmp_path)
    as_ours(doubled)(jnp.arange(3.0), 2)
    assert counted == files(tmp_path) == []
    assert list(tmp_path.glob("compiled/*/*-cache"))


def test_half_files_of_jax_are_removed(keep, tmp_path):
    """JAX would warn of them for ever."""
    keep(tmp_path)
    as_ours(doubled)(jnp.arange(3.0), 2)
    whole, *others = sorted(tmp_path.glob("compiled/*/*-cache"))
    said = whole.read_bytes()
    (whole.parent / "half-cache").write_bytes(said[: len(said) // 2])
    (whole.parent / "none-cache").write_bytes(b"")
    keep(tmp_path)
    assert sorted(tmp_path.glob("compiled/*/*-cache")) == [whole, *others]


def test_programs_nobody_asks_for_are_removed(keep, tmp_path):
    """Those alone, and no other files that may lie there."""
    keep(tmp_path)
    program, x = as_ours(doubled), jnp.arange(3.0)
    program(x, 2)
    old = {*files(tmp_path), *tmp_path.glob("compiled/*/*-cache")}
    program(x, 3.0)
    new = {*files(tmp_path), *tmp_path.glob("compiled/*/*-cache")} - old
    mine = tmp_path / "notes"
    mine.write_text("of the user")
    assert len(old) >= 2
    assert new
    for file in (*old, mine):
        os.utime(file, (time.time() - 91 * 86400,) * 2)
    for file in new:  # written long ago, but read since
        os.utime(file, (time.time() - 89 * 86400, time.time() - 200 * 86400))
    keep(tmp_path)
    assert {*files(tmp_path), *tmp_path.glob("compiled/*/*-cache")} == new
    assert mine.exists()
    forget(program)
    np.testing.assert_array_equal(program(x, 2)["found"], 2 * x)


def test_functions_among_arguments(keep, counted, tmp_path):
    """They are told from others by what they compute, and come back as those that were given."""

    def applied(x, function):
        return {"found": function(x), "by": function}

    def times(factor, power=1):
        return lambda x: factor * x**power

    keep(tmp_path)
    x, program = jnp.arange(3.0), as_ours(applied)
    for function, most in (
        (times(2.0), 1), (times(2.0), 1), (times(3.0), 2), (times(2.0, 2), 3), (times(x), 4),
        (times(x + 1), 5), (lambda x: 2.0 * x, 6), (lambda x: 2.0 + x, 7), (lambda x: 2.0 * x, 7),
    ):  # fmt: skip
        forget(program)
        found = program(x, function)
        np.testing.assert_array_equal(found["found"], function(x))
        assert found["by"] is function
        assert len(counted) == len(files(tmp_path)) == most


def test_what_is_not_kept(keep, counted, tmp_path):
    """Classes of a user, functions that refer to them, and what calls back to Python, answer as
    ever."""

    def applied(x, function):
        return function(x) if callable(function) else function.factor * x

    def told(x):
        return eqx.error_if(2 * x, x[0] > 5, "large")

    keep(tmp_path)
    x = jnp.arange(3.0)
    for given in (lambda x: OWN.factor * x, OWN):
        np.testing.assert_array_equal(as_ours(applied)(x, given), 2 * x)
    np.testing.assert_array_equal(as_ours(told)(x), 2 * x)
    assert files(tmp_path) == []
    np.testing.assert_array_equal(as_ours(applied)(x, jnp.sin), jnp.sin(x))
    assert len(files(tmp_path)) == 1
    assert as_ours(lambda x: 2 * x)(x).shape == (3,)
    assert Program(lambda x: 2 * x)(x).shape == (3,)  # has no name
    assert len(files(tmp_path)) == 2


class Own(eqx.Module):
    factor: jax.Array


OWN = Own(jnp.asarray(2.0))


def test_kept_says_what_is_not_kept(keep, tmp_path):
    """And answers as ever."""
    keep(tmp_path)
    for function, argument, why in (
        (lambda x: OWN.factor * x, 2.0, "the class Own"),
        (lambda own: 2 * own.factor, OWN, "the class Own"),
        (lambda x: Own(x).factor * 2, 2.0, "the class Own"),
        (lambda x: 2 * eqx.error_if(x, x > 5, "large"), 2.0, "it calls back to Python"),
    ):
        with pytest.warns(UserWarning, match=why):
            assert jb.programs.kept(function)(argument) == 4
    assert files(tmp_path) == []
    with pytest.raises(ValueError, match="of the user"):
        jb.programs.kept(failing)(2.0)


def failing(x):
    raise ValueError("of the user")


def test_within_other_programs_nothing_is_kept(keep, counted, tmp_path):
    keep(tmp_path)
    program, x = as_ours(doubled), jnp.arange(3.0)
    jax.jit(lambda x: program(x, 2)["found"])(x)
    jax.grad(lambda x: program(x, 2)["found"].sum())(x)
    jax.vmap(lambda x: program(x, 2)["found"])(x)
    assert counted == []


def test_both_levels_share_a_trace(keep, counted, tmp_path):
    keep(tmp_path)
    program, x = as_ours(doubled), jnp.arange(3.0)
    np.testing.assert_array_equal(program.quick(x, 2)["found"], program.well(x, 2)["found"])
    assert len(counted) == 1


def test_what_is_prepared_is_what_is_called(keep, counted, tmp_path):
    """Compiled once, ahead of the call."""
    keep(tmp_path)
    program, x = as_ours(doubled), jnp.arange(5.0)
    program.prepare(x, 3)
    there = set(tmp_path.glob("compiled/*/jit_doubled-*"))
    assert len(there) == len(counted) == 1
    np.testing.assert_array_equal(program(x, 3)["found"], 3 * x)
    assert there == set(tmp_path.glob("compiled/*/jit_doubled-*"))
    assert len(counted) == 1


def test_text_and_back():
    """What comes back is the same, type by type, and what has no text is refused."""
    parts = SMALL, jb.Status.OK, np.arange(3), np.float32(0.1), float("inf"), -0.0, 1 + 2j, b"x"
    given = ((*parts, jnp.sin, jb.Hybrid, np.dtype("int8"), {"a": (1, True, None, "b")}),)
    said = json.loads(json.dumps(Encoder(lambda array: 0)(given, static=True)))
    found = decoded(said, lambda i: i, None)
    for one, other in zip(jax.tree.leaves(given), jax.tree.leaves(found), strict=True):
        assert type(one) is type(other)
        np.testing.assert_array_equal(one, other)
    assert str(found[0][1:]) == str(given[0][1:])
    assert found[0][0] == SMALL
    again = Encoder(lambda array: 0)(found, static=True)
    assert again == Encoder(lambda array: 0)(given, static=True)
    texts = [json.dumps(Encoder(lambda a: 0)(x, True)) for x in (1, 1.0, True, "1", (1,), [1], 1j)]
    assert len(set(texts)) == len(texts)

    class Own:
        pass

    masked = np.ma.masked_array([1.0, 2.0], [True, False])
    for refused in (Own(), Own, lambda x: x, {1, 2}, masked, np.array([Own()]), json):
        with pytest.raises(NotKept):
            Encoder(lambda array: 0)(refused, static=True)


@pytest.mark.parametrize(
    "said",
    [
        ["name", "os", "system"], ["of", "subprocess", "Popen", ["args", "true"]],
        ["of", "jax", "jit"], ["named", "jax.numpy", "sin"], ["enum", "jaxbeam", "Beam", "OK"],
        ["of", "jaxbeam._rotor.beam", "Beam", ["__class__", 1]], ["called", "jax", "jit"],
    ],
)  # fmt: skip
def test_a_text_calls_nothing(said):
    with pytest.raises((NotKept, TypeError)):
        decoded(said, lambda i: i, None)


def test_the_command_keeps(keep, counted, tmp_path, monkeypatch, capsys):
    """Scenes by their tables, but for those that read a file, which may change."""
    monkeypatch.setenv("JAXBEAM_KEEP", str(tmp_path / "kept"))
    scene, words = tmp_path / "scene.toml", SCENE
    for number, (text, most) in enumerate(
        [(words, 1), (words, 1), (words.replace("8.0", "7.0"), 2), (words + "tip_mass = 0.1", 3)]
    ):
        scene.write_text(text)
        assert main([str(scene), "--out", str(tmp_path / str(number))]) == 0
        assert len(counted) == most
        assert str(tmp_path / "kept") in capsys.readouterr().out
    assert main([str(scene), "--out", str(tmp_path / "none"), "--no-keep"]) == 0
    assert "kept" not in capsys.readouterr().out
