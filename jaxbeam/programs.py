"""Programs: what the first answer waits for, and how well it is compiled.

What a fresh process waits for is compilation, most of that the optimiser. So what is called outside
of `jax.jit`, in derivatives too, is compiled without it at first: that takes a fifth to a half of
the time, and the program runs six to ten times as long, which is milliseconds for one answer. After
32 calls with arguments of one kind (the same model, shapes and functions; numbers may differ) it is
compiled well. That is a count and no clock: the same script gives the same numbers each time that
it runs. A run in time of more than 4000 steps is made anew by a program that is compiled well.
Sweeps, fits, ladders and batches begin with that.

The two kinds of program differ in the last bits, by some 1e-14 of values and 4e-12 of gradients,
as two releases of JAX do. `compile_well()` takes good programs from the first call on.

`keep` lets the next process answer without tracing and compiling again, and `kept` does so for
functions of yours.

Your own `jax.jit` compiles well, however often you call it. For what is called a few times hand it
`QUICK`:

>>> import jax
>>> import jaxbeam as jb
>>> jax.config.update("jax_enable_x64", True)
>>> def frequency(hub_radius):
...     rotor = jb.Rotor(jb.Beam(8.0, 0.2, 5e7, 566.0, 566.0), hub_radius)
...     return jb.modes(jb.Hybrid(), rotor, 4.0, throw=False).frequency[0]
>>> slope = jax.jit(jax.grad(frequency), compiler_options=jb.programs.QUICK)
>>> bool(slope(0.5) > 0)
True
"""

from jaxbeam._programs.folder import keep as keep
from jaxbeam._programs.kept import kept as kept
from jaxbeam._programs.program import QUICK as QUICK
from jaxbeam._programs.program import compile_well as compile_well
