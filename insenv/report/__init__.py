"""What is shown and kept of a run: tables for a terminal, figures, result files, the JSON document."""

from insenv.report.document import document, to_json
from insenv.report.files import FilesWritten, OutputFolder, write_files
from insenv.report.tables import comparison

__all__ = ["FilesWritten", "OutputFolder", "comparison", "document", "to_json", "write_files"]
