"""Results, truth and sensors in the formats of other tools, and simulated drives as recorded logs."""

from insenv.export.formats import FORMATS, check_formats, write
from insenv.export.simulated import record
from insenv.export.tracks import to_dataframes

__all__ = ["FORMATS", "check_formats", "record", "to_dataframes", "write"]
