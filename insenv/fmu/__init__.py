"""FMUs: every estimator and every plant as a self-contained Functional Mock-up Unit for Co-Simulation, FMI 2.0 or 3.0.

    from insenv.fmu import export
    export("qakf-improved", "qakf.fmu")

The FMU's equations are the C that insenv's own native runner is compiled from, its variables the rows of the model's tables.
"""

from insenv.fmu.exporter import export

__all__ = ["export"]
