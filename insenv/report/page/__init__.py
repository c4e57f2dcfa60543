"""The page of a run: one self-contained HTML file, with the front end of the folder ``web/`` and the results as a document."""

from insenv.report.page.html import assembled, check_size
from insenv.report.page.of_run import run_page

__all__ = ["assembled", "check_size", "run_page"]
