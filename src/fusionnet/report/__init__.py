"""From records to what people read: figures and tables beside the thesis's, and their reading.

`gather` collects what has been run; `html_page` makes one self-contained page of it,
`markdown_page` the same for the documentation.
"""

from fusionnet.report.chapters import Chapter, gather
from fusionnet.report.markdown import markdown_page
from fusionnet.report.page import html_page

__all__ = ["Chapter", "gather", "html_page", "markdown_page"]
