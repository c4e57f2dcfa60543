"""What a user holds, sees and keeps of a run: the report, tables for a terminal, figures, result files, the JSON document."""

from insenv.base.output import to_json
from insenv.report.document import document
from insenv.report.files import FilesWritten, OutputFolder, write_files
from insenv.report.run_report import Report
from insenv.report.tables import comparison

__all__ = ["FilesWritten", "OutputFolder", "Report", "comparison", "document", "to_json", "write_files"]
