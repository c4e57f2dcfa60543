"""What a user holds, sees and keeps of a run: the report, tables for a terminal, figures, result files, the JSON document."""

from insenv.base.output import to_json
from insenv.report.document import Document
from insenv.report.files import FilesWritten, OutputFolder, write_document, write_files
from insenv.report.run_report import Report
from insenv.report.tables import run_document

__all__ = ["Document", "FilesWritten", "OutputFolder", "Report", "run_document", "to_json", "write_document", "write_files"]
