"""Functions and integrals that the models are made of."""

import itertools

import mpmath
import numpy as np
import pytest
import scipy.integrate

import jaxbeam as jb
from jaxbeam._models.bases import basis as basis_module
from tests.tiers import exhaustive, slow

BASES = [jb.models.Polynomials(), jb.models.Polynomials(grading=2), jb.models.CantileverModes()]
ids = [repr(b) for b in BASES]


@pytest.mark.parametrize("basis", BASES, ids=ids)
@pytest.mark.parametrize("n", [1, 5, 24])
def test_clamped_at_the_root(basis, n):
    f, g = basis.bending(n, np.zeros(1)), basis.stretch(n, np.zeros(1))
    scale = np.abs(basis.bending(n, np.linspace(0, 1, 50)).slope).max()
    assert np.abs(f.value).max() < 1e-13 * scale
    assert np.abs(f.slope).max() < 1e-13 * scale
    assert np.abs(g.value).max() < 1e-13 * scale


@pytest.mark.parametrize("basis", [*BASES, basis_module.HermiteElements(5)])
def test_derivatives(basis):
    x = np.linspace(0.05, 0.99, 25)
    x = x[np.abs(5 * x - np.round(5 * x)) > 0.02]  # away from the nodes of five elements
    h = 1e-3
    for f, n in ((basis.bending, 10), (basis.stretch, 11)):
        for name, derivative in (("value", "slope"), ("slope", "curvature")):
            table = {k: getattr(f(n, x + k * h), name) for k in (-2, -1, 1, 2)}
            fd = (8 * (table[1] - table[-1]) - (table[2] - table[-2])) / (12 * h)
            exact = getattr(f(n, x), derivative)
            assert np.abs(fd - exact).max() < 1e-5 * np.abs(exact).max()


@pytest.mark.parametrize("n", [4, 24, slow(60), exhaustive(100)])
@pytest.mark.parametrize("grading", [1, 2])
def test_polynomials_make_elastic_stiffness_the_identity(n, grading):
    basis = jb.models.Polynomials(grading)
    bending = basis_module.bending_integrals(basis, n)
    stretch = basis_module.stretch_integrals(basis, n)
    np.testing.assert_allclose(bending.curvature, np.eye(n), atol=1e-12)
    np.testing.assert_allclose(stretch.tension[0], np.eye(n), atol=1e-12)


@pytest.mark.parametrize("n", [8, 20, 40, 80])
def test_cantilever_modes_stay_orthonormal(n):
    """The textbook form has lost every digit long before 40."""
    f = basis_module.bending_integrals(jb.models.CantileverModes(), n)
    b = basis_module.clamped_free_roots(n)
    np.testing.assert_allclose(f.mass, np.eye(n), atol=1e-12)
    np.testing.assert_allclose(f.curvature / np.outer(b, b) ** 2, np.eye(n), atol=1e-12)
    np.testing.assert_allclose(np.abs(f.tip), 2.0, rtol=1e-12)
    g = basis_module.stretch_integrals(jb.models.CantileverModes(), n)
    np.testing.assert_allclose(g.mass, np.eye(n), atol=1e-12)


def test_roots_against_multiple_precision():
    with mpmath.workdps(40):
        for k, root in enumerate(basis_module.clamped_free_roots(20)):
            start = mpmath.mpf(1.9) if k == 0 else (k + mpmath.mpf(1) / 2) * mpmath.pi
            exact = mpmath.findroot(lambda b: mpmath.cos(b) + 1 / mpmath.cosh(b), start)
            assert abs(root - exact) <= 4e-16 * exact


@pytest.mark.parametrize(
    "basis",
    [
        BASES[2], basis_module.HermiteElements(3),
        *(exhaustive(basis) for basis in BASES[:2]),
    ],
)  # fmt: skip
def test_integrals_against_adaptive_quadrature(basis):
    n, ns = (6, 7) if isinstance(basis, basis_module.HermiteElements) else (5, 4)
    f, g = basis_module.bending_integrals(basis, n), basis_module.stretch_integrals(basis, ns)
    t = (lambda x: 1 + 0 * x, lambda x: 1 - x, lambda x: (1 - x**2) / 2)

    def check(got, integrand):
        # in x = t^2, since graded functions are smooth in t only; pieces between nodes of elements
        breaks = np.sqrt(np.linspace(0, 1, 4))
        pieces = [
            scipy.integrate.quad_vec(lambda t: 2 * t * integrand(t * t), a, b, epsrel=1e-12)[0]
            for a, b in itertools.pairwise(breaks)
        ]
        expected = sum(pieces)
        np.testing.assert_allclose(got, expected, atol=1e-11 * np.abs(expected).max())

    def one(method, size, name, x):
        return getattr(method(size, np.array([x])), name)[0]

    def outer(a, b):
        return np.outer(a, b)

    for k in range(3):
        check(
            f.tension[k],
            lambda x, k=k: t[k](x) * outer(*[one(basis.bending, n, "slope", x)] * 2),
        )
    check(f.mass, lambda x: outer(*[one(basis.bending, n, "value", x)] * 2))
    check(f.curvature, lambda x: outer(*[one(basis.bending, n, "curvature", x)] * 2))
    check(g.mass, lambda x: outer(*[one(basis.stretch, ns, "value", x)] * 2))


def test_hermite_shapes_interpolate_cubics():
    s = np.linspace(0, 1, 7)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.5, 3.0])
    h = 0.3
    nodal = [cubic(0), cubic.deriv()(0), cubic(h), cubic.deriv()(h)]
    shapes = basis_module.hermite(s, h)
    for d, table in enumerate(shapes):
        exact = cubic.deriv(d)(s * h) if d else cubic(s * h)
        np.testing.assert_allclose(table @ nodal, exact, atol=1e-12)


def test_bad_sizes():
    for bad in (3, 0, 1.0, True):
        with pytest.raises(ValueError, match="grading must be 1 or 2"):
            jb.models.Polynomials(grading=bad)
    with pytest.raises(TypeError, match="basis must be a Basis"):
        jb.Hybrid(2, 2, 2, "polynomials")
    with pytest.raises(ValueError, match="Hermite elements have 6 functions, not 5"):
        basis_module.HermiteElements(3).bending(5, np.zeros(1))
