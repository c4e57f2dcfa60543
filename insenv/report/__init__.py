"""What a user holds, sees and keeps of a result: its `Document`, rendered for terminals, pages, figures and files."""

from insenv.base.output import to_json
from insenv.report.document import Document
from insenv.report.files import FilesWritten, OutputFolder, write_document
from insenv.report.notebook import Shown
from insenv.report.run_report import Report, run_document, write_files

__all__ = [
    "Document",
    "FilesWritten",
    "OutputFolder",
    "Report",
    "Shown",
    "run_document",
    "to_json",
    "write_document",
    "write_files",
]
