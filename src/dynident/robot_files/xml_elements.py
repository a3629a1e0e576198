"""Read the XML of a robot file into a small tree, or refuse it: no entities, no outside files, bounded size.

Attributes are read as numbers and words, each checked; an error names the file, the element and the remedy.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final
from xml.parsers import expat

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError, nearest
from dynident.model.documents.numbers import Place, check_name, decimal, shown

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


@dataclass(frozen=True)
class Values:
    """Values by name, as a file writes them.

    Attributes:
        place: Where they are.
        given: The texts by name, defaults included.
    """

    place: Place
    given: Mapping[str, str]

    def __contains__(self, name: str) -> bool:
        return name in self.given

    def known(self, names: Collection[str]) -> Values:
        """Return the values after a check that there are no others.

        Raises:
            DescriptionError: An unknown name; the message has the nearest known one.
        """
        for name in self.given:
            if name not in names:
                raise self.place.error(
                    f"unknown attribute {shown(name)}", f"remove or correct it{nearest(name, names)}"
                )
        return self

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text.

        Raises:
            DescriptionError: Missing without a default.
        """
        found = self.given.get(name, default)
        if found is None:
            raise self.place.error(f"no attribute '{name}'", f'write {name}="..."')
        return found

    def name(self, name: str) -> str:
        """Return a name: a text that is not empty and can be printed."""
        return check_name(self.place, name, self.text(name))

    def choice(self, name: str, words: Collection[str], default: str) -> str:
        """Return one of some words.

        Raises:
            DescriptionError: Another word.
        """
        word = self.text(name, default)
        if word not in words:
            step = f"choose one of: {', '.join(words)}{nearest(word, words)}"
            raise self.place.error(f"{name} {shown(word)} is not known", step)
        return word

    def flag(self, name: str, default: bool) -> bool:
        """Return whether ``true`` is written."""
        return self.choice(name, ("true", "false"), "true" if default else "false") == "true"

    def number(self, name: str, default: float | None = None) -> float:
        """Return a finite number."""
        if name not in self.given and default is not None:
            return default
        return decimal(self.place, name, self.text(name))

    def at_least_zero(self, name: str, default: float | None = None) -> float:
        """Return a number that is not negative."""
        value = self.number(name, default)
        if value < 0:
            raise self.place.error(f"{name} {value:g} is negative", "write 0 or more")
        return value

    def numbers(self, name: str, least: int, most: int = 0) -> Array:
        """Return as many numbers as there have to be: ``least``, or up to ``most``.

        Raises:
            DescriptionError: Fewer or more, or one that is no number.
        """
        text = self.text(name)
        words = text.split()
        if not least <= len(words) <= max(least, most):
            step = f"write {least}{f' to {most}' if most > least else ''} numbers with spaces between them"
            raise self.place.error(f"{name} {shown(text)} has {len(words)} numbers", step)
        return np.array([decimal(self.place, name, word) for word in words])
