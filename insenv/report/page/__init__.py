"""Pages: one self-contained HTML file each, with the front end of the folder ``web/`` and the results as a document."""

from insenv.report.page.html import assembled, check_size, compressed
from insenv.report.page.report import html, page_json

__all__ = ["assembled", "check_size", "compressed", "html", "page_json"]
