"""FMUs: every estimator and every plant as a self-contained Functional Mock-up Unit for Co-Simulation, FMI 2.0 or 3.0.

    from insenv.fmu import export, run
    export("qakf-improved", "qakf.fmu")

The equations of an FMU are the same C code that insenv's native runner is compiled from; its variables are the rows of the
model's tables.  `run` steps any FMU, of insenv or of another tool, over sampled inputs.
"""

from insenv.fmu.exporter import export
from insenv.fmu.running import run

__all__ = ["export", "run"]
