"""Filters on a microcontroller: an estimator as plain C with the test that it gives the same bits there.

    insenv.export_c("loosely-coupled", "car-city-drive", output="filter")

The C comes from `insenv.core.portable`.  Beside it lie the inputs and outputs of a run, a program that compares them, and the
means to build it for this machine and for a Cortex-M7 in qemu.
"""

from insenv.export.board.check import Checked, check_c
from insenv.export.board.exporter import BoardFiles, export_c
from insenv.export.board.figures import Figures

__all__ = ["BoardFiles", "Checked", "Figures", "check_c", "export_c"]
