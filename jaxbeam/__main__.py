"""Sweeps and spin-ups that a TOML file describes, for those who do not want to write a script."""

import argparse
import dataclasses
import sys
import tomllib
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jaxbeam as jb
from jaxbeam import plot
from jaxbeam._command.examples import EPILOG, EXAMPLES
from jaxbeam._command.questions import QUESTIONS
from jaxbeam._command.scene import Job, read


def run(scene: Job, out: Path, cores: int, chunk: int) -> bool:
    """Answer the question, write all files, and say what became of the cases."""
    if scene.axes:
        cases = jb.grid(**scene.axes)
        print(f"{len(cases)} cases over {', '.join(cases.names)}", flush=True)
        how: Any = {"chunk": chunk, "devices": cores * jax.devices(), "folder": out / "chunks"}
        table = jb.sweep(scene.case, cases, dims=scene.dims, **how)
        drawn, label = next(iter(scene.dims)), QUESTIONS[scene.question][2]
        status, figure = table["status"], plot.swept(table, drawn, label)
        values = {n: v for n, v in table.values.items() if "time" not in table.dims[n]}
    else:
        values = {name: np.asarray(value) for name, value in scene.case().items()}
        coords = {d: np.array(c) for further in scene.dims.values() for d, c in further.items()}
        status = values["status"]
        values["status"] = np.full(coords["time"].shape, status)
        table = jb.Table(values, {n: tuple(scene.dims.get(n, ["time"])) for n in values}, coords)
        figure = plot.history(table)
    out.mkdir(parents=True, exist_ok=True)
    path = out / scene.question
    table.save(path.with_suffix(".npz"))
    dataclasses.replace(table, values=values).to_csv(path.with_suffix(".csv"))
    figure.savefig(path.with_suffix(".png"), dpi=150)
    print(f"{np.sum(status == jb.Status.OK)} of {status.size} ok")
    for code, count in zip(*np.unique(status, return_counts=True), strict=True):
        if code != jb.Status.OK:
            print(f"{count} {jb.Status(code).name}: {jb.Status(code).message}")
    print(f"{path}.csv, .npz and .png")
    return bool((status == jb.Status.OK).any())


def main(argv: list[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser("python -m jaxbeam", description=__doc__, epilog=EPILOG)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("scene", nargs="?", type=Path, metavar="SCENE.toml")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="default: the name of the file")
    parser.add_argument("--cores", type=int, default=1, metavar="N", help="chunks at once (1)")
    parser.add_argument("--chunk", type=int, default=32, metavar="N", help="cases at once (32)")
    parser.add_argument("--no-keep", action="store_true", help="compile programs anew")
    parser.add_argument("--example", choices=list(EXAMPLES), help="print a scene that runs")
    parser.add_argument("--version", action="version", version=f"jaxbeam {jb.__version__}")
    given = parser.parse_args(argv)
    if given.example:
        print(EXAMPLES[given.example], end="")
        return 0
    if given.scene is None or given.cores < 1 or given.chunk < 1:
        parser.error("name a SCENE.toml, and one core and one case at least")
    jax.config.update("jax_enable_x64", True)
    try:
        if not given.no_keep and (folder := jb.keep()):
            print(f"programs are kept in {folder}", flush=True)
        tables = tomllib.loads(given.scene.read_text("utf-8-sig"))
        if isinstance(beam := tables.get("beam"), dict) and isinstance(beam.get("file"), str):
            # The path is relative to the scene.
            beam["file"] = str(given.scene.parent / beam["file"])
        out = given.out or Path(given.scene.stem)
        return 0 if run(read(tables), out, given.cores, given.chunk) else 1
    except (ValueError, OSError, ImportError) as error:  # errors of the file or the folder
        where, said = getattr(error, "filename", None), getattr(error, "strerror", None)
        said = str(said or error).splitlines()[0]
        print(f"{where or given.scene}: {said}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped: the same command goes on with what is left of a sweep", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
