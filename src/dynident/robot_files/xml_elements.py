"""Read the XML of a robot file into a small tree, or refuse it: no entities, no outside files, bounded size."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final
from xml.parsers import expat

from dynident.errors import DescriptionError
from dynident.model.documents.numbers import Place, shown

MAX_DEPTH: Final = 64
MAX_LINKS: Final = 1000
MAX_ELEMENTS: Final = 20 * MAX_LINKS


@dataclass(frozen=True)
class Element:
    """An element of the file.

    Attributes:
        tag: Its name.
        line: Its line in the file, from 1.
        attributes: Its attributes.
        children: The elements in it that are read.
        path: The file, for messages and for a model that is written back.
        number: How many elements begin before it in the file.
        words: Pieces of the text directly in it.
    """

    tag: str
    line: int
    attributes: Mapping[str, str]
    children: list[Element] = field(default_factory=list)
    path: object = ""
    number: int = 0
    words: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """The text directly in it, without blanks around it."""
        return "".join(self.words).strip()

    @property
    def place(self) -> Place:
        """Where it is: file, line and element."""
        key = next((key for key in ("name", "class") if self.attributes.get(key)), "")
        told = f" {key}={shown(self.attributes[key])}" if key else ""
        return Place(self.path, f"line {self.line}, <{self.tag}{told}>")

    def all(self, tag: str) -> list[Element]:
        """Return the children of one name."""
        return [child for child in self.children if child.tag == tag]

    def below(self) -> Iterator[Element]:
        """Yield the elements in it, however deep, in the order of the file."""
        for child in self.children:
            yield child
            yield from child.below()


@dataclass(frozen=True)
class XmlLanguage:
    """What a format of robot models is in XML.

    Attributes:
        noun: What a file of it is called.
        roots: Names of the first element.
        link: Name of the elements of which there is a bound.
        children: Names of the elements that are read in each; None reads all.
        opened: Called with the place and the name of each element, those that are not read included.
        kept: Called with the place of each element that is read, with it and with its parent.
    """

    noun: str
    roots: tuple[str, ...]
    link: str
    children: Mapping[str, frozenset[str]] | None = None
    opened: Callable[[Place, str], None] | None = None
    kept: Callable[[Place, Element, Element | None], None] | None = None

    def reads(self, parent: Element, name: str) -> bool:
        """Return whether an element of this name is read in another."""
        return self.children is None or name in self.children.get(parent.tag, ())


def parse_xml(path: object, data: bytes, language: XmlLanguage) -> Element:
    """Return the first element of a file with the elements that are read.

    Raises:
        DescriptionError: No XML, a document type or entity, another root element, too deep, too many links.
    """
    builder = _Builder(path, language)
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as problem:
        place = Place(path, f"line {problem.lineno}")
        step = "correct the line, or write the file again with the tool that made it"
        raise place.error(f"not XML ({expat.ErrorString(problem.code)})", step) from problem
    except (LookupError, ValueError) as problem:  # an encoding that Python does not know or cannot decode
        raise builder.place().error(f"not XML ({problem})", "save the file as UTF-8") from problem
    if builder.root is None:
        raise DescriptionError(path, "", "not XML (no element)", f"give a {language.noun}")
    return builder.root


class _Builder:
    """Builds the tree; elements that are not read are counted only for their depth.

    Entities and outside files are declared in a document type or nowhere, so that this is refused as it begins.
    """

    def __init__(self, path: object, language: XmlLanguage) -> None:
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler, self.parser.EndElementHandler = self._begin, self._end
        self.parser.CharacterDataHandler, self.parser.StartDoctypeDeclHandler = self._characters, self._refuse
        self._path = path
        self._language = language
        self._open: list[Element | None] = []  # None: passed over, with all that is in it
        self._begun = 0
        self._kept = 0
        self._links = 0
        self.root: Element | None = None

    def place(self) -> Place:
        """Return the line that is being read."""
        return Place(self._path, f"line {self.parser.CurrentLineNumber}")

    def _refuse(self, *doctype: object) -> None:
        step = "remove the <!DOCTYPE ...> part: it can hide entities and outside files"
        raise self.place().error("it has a document type (DTD) or an entity", step)

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        language = self._language
        if len(self._open) >= MAX_DEPTH:
            step = f"give the {language.noun} of one robot"
            raise self.place().error(f"elements more than {MAX_DEPTH} levels deep", step)
        if language.opened is not None:
            language.opened(self.place(), name)
        parent = self._open[-1] if self._open else None
        self._begun += 1
        if not self._open and name not in language.roots:
            evidence = f"the file begins with <{name}>, not with <{language.roots[0]}>"
            raise self.place().error(evidence, f"give a {language.noun}")
        if self._open and (parent is None or not language.reads(parent, name)):
            self._open.append(None)
            return
        element = Element(name, self.parser.CurrentLineNumber, attributes, path=self._path, number=self._begun - 1)
        self._check(element, parent)
        if parent is None:
            self.root = element
        else:
            parent.children.append(element)
        self._open.append(element)

    def _characters(self, content: str) -> None:
        if self._open and self._open[-1] is not None:
            self._open[-1].words.append(content)

    def _end(self, name: str) -> None:
        self._open.pop()

    def _check(self, element: Element, parent: Element | None) -> None:
        self._kept += 1
        self._links += element.tag == self._language.link
        if self._links > MAX_LINKS:
            evidence = f"more than {MAX_LINKS} {'links' if self._language.link == 'link' else 'bodies'}"
            raise self.place().error(evidence, f"give the {self._language.noun} of one robot")
        if self._kept > MAX_ELEMENTS:
            raise self.place().error(
                f"more than {MAX_ELEMENTS} elements", f"give the {self._language.noun} of one robot"
            )
        if self._language.kept is not None:
            self._language.kept(self.place(), element, parent)
