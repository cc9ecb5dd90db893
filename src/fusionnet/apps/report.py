"""`fusionnet report`: one page of all that has been run, beside the thesis's numbers."""

from dataclasses import dataclass
from pathlib import Path

from fusionnet.errors import InputError
from fusionnet.files import check_file, write_whole
from fusionnet.report import gather, html_page, markdown_page


@dataclass(frozen=True, kw_only=True)
class ReportConfig:
    """Where the results are, and where the page goes."""

    results: Path = Path("results/experiments")
    """Folder of the records that `fusionnet reproduce` wrote."""
    out: Path = Path("report.html")
    """The page: one file that needs no other."""
    markdown: Path | None = None
    """Also write the page as Markdown here, its figures to a folder `results` beside it."""


def report(config: ReportConfig) -> None:
    """Draw every experiment that has been run beside the thesis's figures and numbers.

    Raises:
        InputError: If there is no folder of results.
    """
    if not config.results.is_dir():
        raise InputError(
            f"There is no folder of results {config.results}; `fusionnet reproduce NAME` writes "
            "one (--results), and where it lies is said with --results here, too."
        )
    check_file(config.out)
    if config.markdown is not None:
        check_file(config.markdown)
    chapters = gather(config.results)
    write_whole(config.out, html_page(chapters))
    if config.markdown is not None:
        text, figures = markdown_page(chapters, "results")
        for name, drawing in figures.items():
            write_whole(config.markdown.parent / "results" / name, drawing)
        write_whole(config.markdown, text)
    run = sum(chapter.scale is not None for chapter in chapters)
    print(f"{config.out}: {run} of {len(chapters)} experiments have been run")
