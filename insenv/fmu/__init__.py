"""FMUs: every estimator and every plant as a self-contained Functional Mock-up Unit for Co-Simulation, FMI 2.0 or 3.0.

    insenv.export_fmu("qakf-improved", "qakf.fmu")

The equations of an FMU are the same C code that insenv's native runner is compiled from; its variables are the rows of the
model's tables.  `run` steps any FMU, of insenv or of another tool, over sampled inputs.
"""

from insenv.fmu.exporter import export_fmu
from insenv.fmu.running import run
from insenv.fmu.ssp import export_ssp
from insenv.fmu.system import run_ssp

__all__ = ["export_fmu", "export_ssp", "run", "run_ssp"]
