"""What a section of the report is: a title, a template and the values that the template needs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from markupsafe import Markup

from dynident.results.figures.files import file_stem
from dynident.results.report.subject import MOST_DRAWN, Subject


class ReportSection(ABC):
    """A frozen dataclass whose fields are its options.

    Attributes:
        title: Heading on the page and in its table of contents.
        template: File in the folder ``templates``, called as the part; beside the part's own file where an installed
            package adds it.
    """

    title: ClassVar[str]
    template: ClassVar[str]

    def __init_subclass__(cls) -> None:
        if "template" not in vars(cls):
            cls.template = f"{cls.__module__.rpartition('.')[2]}.html"

    @abstractmethod
    def context(self, subject: Subject) -> dict[str, Any]:
        """Return what the template needs; empty where there is nothing to show, and the section is left out.

        Text is put in as it is: the page escapes it. Only what :func:`drawn` returns is taken as markup.
        """


class Drawing(Markup):
    """A figure as markup for the page, with the name that it has as a file.

    Attributes:
        stem: Name of its file without a suffix.
    """

    stem: str = ""


def drawn(figure: str, *words: str) -> Drawing:
    """Return a figure of :mod:`dynident.results.figures`, which escapes its own text, as markup for the page.

    Args:
        figure: SVG.
        words: What it shows, such as ``torque``, the data set and the joint: the name of its file is made of them.
    """
    drawing = Drawing(figure)
    drawing.stem = file_stem(*words)
    return drawing


def left_out(subject: Subject) -> str:
    """Return the sentence that says which data sets have no figures; empty where all have."""
    count = len(subject.datasets)
    return (
        f"Figures show the first {MOST_DRAWN} of {count} data sets; the tables have all." if count > MOST_DRAWN else ""
    )
