"""How the tests compile: read by conftest.py before XLA starts, so nothing here may start it.

Much of the time of all tests is LLVM's, so it does not optimise: neither in the process of the
tests nor in one that inherits its environment. A test asks for optimised programs by
`helpers.optimised`, where a function of its own runs longer than it compiles, or by
`helpers.run_optimised`, where it is about what users run: that takes a process of its own, since
XLA reads its flags once.
"""

from importlib.metadata import version

# Emitters of code that XLA has beside others: with them it takes half as long.
OLD_EMITTERS = version("jaxlib").startswith("0.10.")


def xla_flags(level: int) -> str:
    """How far LLVM optimises, from 0 to 3; by the emitters that take half as long if there are, and
    in one piece: to cut a program into pieces for several cores takes a tenth of the time, and here
    each core has programs of its own."""
    # Releases that do not know this flag end the process.
    emitters = ["--xla_cpu_use_fusion_emitters=false"] if OLD_EMITTERS else []
    whole = "--xla_cpu_parallel_codegen_split_count=1"
    return " ".join([f"--xla_backend_optimization_level={level}", whole, *emitters])
