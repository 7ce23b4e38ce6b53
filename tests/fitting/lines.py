"""An experiment whose fit has a closed form."""

import jax
import jax.numpy as jnp

import jaxbeam as jb


def line(x, y, noise=1.0):
    """A straight line, as an experiment: what least squares say of it is in every textbook."""

    class Line(jb.fitting.Experiment):
        a: jax.Array
        b: jax.Array
        measured: jax.Array
        noise: jax.Array

        def predicted(self):
            return self.a + self.b * x

    return lambda a, b: Line(a, b, jnp.asarray(y), noise * jnp.ones(len(y)))
