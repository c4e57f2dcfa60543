"""What leaves insenv for other tools: results and logs in their formats (`write`, `record`), and filters as C (`board`)."""

from insenv.export.data import FORMATS, check_formats, contents_of, needs_log, record, to_dataframes, write

__all__ = ["FORMATS", "check_formats", "contents_of", "needs_log", "record", "to_dataframes", "write"]
