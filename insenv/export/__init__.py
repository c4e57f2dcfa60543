"""Results, truth and sensors in the formats of other tools, and simulated drives as recorded logs."""

from insenv.export.formats import check_formats, to_dataframes, write
from insenv.export.simulated import record
from insenv.logs.formats import WRITTEN as FORMATS

__all__ = ["FORMATS", "check_formats", "record", "to_dataframes", "write"]
