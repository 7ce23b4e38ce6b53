"""Files of HAWC2, written."""

from pathlib import Path

import numpy as np

from jaxbeam._files.beamdyn_writer import known_blade, numbers_of
from jaxbeam._files.hawc2 import COLUMNS, angle_of, tension_centre
from jaxbeam._files.section_axes import HAWC2, Piece, Sixes, about_third, seen_from, shift
from jaxbeam._files.texts import FilePath
from jaxbeam._rotor.blade import Blade
from jaxbeam._rotor.sections import SIXES

# Relative size of entries that a file of HAWC2 cannot hold, up to which they count as zero.
_SAME = 1e-9
_ROUND = 1e-9  # relative difference of moments of inertia up to which principal axes are arbitrary


def write_hawc2(path: FilePath, blade: Blade, *, title: str = "written by jaxbeam") -> None:
    """Write a `Blade` as a main body of HAWC2, with an st file beside it.

    `path` is that of the htc file, which has the main body "blade1" alone; "_st.dat" behind its
    stem makes that of the st file. `blade` is the blade: its axis becomes the c2_def, matrices are
    written about the tension centre, in the axes in which the inertia about it has no product, at
    its stations, all with as many digits as it has. `title` is a comment in both.

    `read_hawc2` reads it back, with `gyration_about_mass_centre=False`.

    Raises `TypeError` unless all numbers are known, and `ValueError` for what HAWC2 has no numbers
    for: point masses, `gyration`, kinks, an axis that turns back, and inertias of other than plane
    sections.
    """
    path = Path(path)
    axis, twist, stiffness, inertia = known_blade(blade, "HAWC2")
    if blade.kinks:
        raise ValueError(f"kinks: a c2_def of HAWC2 has none, got {blade.kinks}")
    beside = path.with_name(f"{path.stem}_st.dat")
    title = title.splitlines()[0] if title else ""
    _, slope, _ = Piece(axis, twist).at(axis[:, 0])
    angle = np.rad2deg(angle_of(slope, twist))
    rows = _rows(seen_from(HAWC2.T, stiffness), seen_from(HAWC2.T, inertia))
    along = np.asarray(blade.stations) * float(blade.length)
    c2_def = numbers_of(np.concatenate([axis @ HAWC2, angle[:, None]], 1))
    body = [
        f"; {title}",
        "begin main_body;",
        "  name blade1;",
        "  type timoschenko;",
        "  nbodies 1;",
        "  node_distribution c2_def;",
        "  begin timoschenko_input;",
        f"    filename ./{beside.name};",
        "    FPM 1;",
        "    set 1 1;",
        "  end timoschenko_input;",
        "  begin c2_def;",
        f"    nsec {len(axis)};",
        *(f"    sec {i} {row};" for i, row in enumerate(c2_def, 1)),
        "  end c2_def;",
        "end main_body;",
    ]
    sections = [
        "1 ; number of sets",
        "-----------------",
        f"#1 {title}",
        " ".join(COLUMNS),
        f"$1 {len(rows)}",
        *numbers_of(np.concatenate([along[:, None], rows], 1)),
    ]
    for file, lines in ((path, body), (beside, sections)):
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _rows(stiffness: Sixes, inertia: Sixes) -> np.ndarray:
    """Columns of the st file after r, from matrices in its axes about the reference axis."""
    mass = inertia[:, 0, 0]
    gravity = np.stack([inertia[:, 1, 5], -inertia[:, 0, 5]], 1) / mass[:, None]
    elastic = tension_centre(stiffness)
    back = np.linalg.inv(shift(*elastic.T))
    stiffness, about = (back.swapaxes(1, 2) @ each @ back for each in (stiffness, inertia))
    pitch = _pitch(about[:, 3:5, 3:5])
    axes = about_third(pitch)
    stiffness, own = (axes.swapaxes(1, 2) @ each @ axes for each in (stiffness, about))
    moments = np.diagonal(own, axis1=1, axis2=2)[:, 3:5]
    _check_plane(inertia, own, mass, gravity)
    return np.concatenate(
        [
            mass[:, None], gravity, np.sqrt(moments / mass[:, None]),
            np.rad2deg(pitch)[:, None], elastic, stiffness[:, SIXES[0], SIXES[1]],
        ],
        1,
    )  # fmt: skip


def _pitch(moments: np.ndarray) -> np.ndarray:
    """Angles of principal axes of moments of inertia (n, 2, 2), each near to the one before."""
    found = [0.0]
    for own in moments:
        apart = own[0, 0] - own[1, 1], 2 * own[0, 1]
        angle = found[-1]
        if np.hypot(*apart) > _ROUND * np.trace(own):
            principal = np.arctan2(apart[1], apart[0]) / 2
            angle = principal + np.round((angle - principal) / (np.pi / 2)) * np.pi / 2
        found.append(float(angle))
    return np.array(found[1:])


def _check_plane(inertia: Sixes, own: Sixes, mass: np.ndarray, gravity: np.ndarray) -> None:
    """Raise `ValueError` where an inertia is not that of a mass, its centre and two radii of
    gyration."""
    size = own[:, 5, 5]
    plain = shift(*gravity.T)[:, :3]
    plain = mass[:, None, None] * plain  # these rows are momenta per mass
    scale = np.stack([mass] * 3 + [np.sqrt(mass * size)] * 3, 1)
    wrong = np.max(np.abs(inertia[:, :3] - plain) / scale[:, None], axis=(1, 2)) > _SAME
    wrong |= np.abs(own[:, 5, 5] - own[:, 3, 3] - own[:, 4, 4]) > _SAME * size
    wrong |= np.max(np.abs(own[:, 5, 3:5]), axis=1) > _SAME * size
    if np.any(wrong):
        raise ValueError(
            f"inertia: at station {np.argmax(wrong) + 1} it is not that of a plane section, which "
            "has one mass, its centre in the section, and a polar moment that is the sum of the "
            "other two; HAWC2 has no numbers for more"
        )
