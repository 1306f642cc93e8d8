"""Edit the text of an XML file at its attributes, so that comments, order and layout stay as written.

An MJCF may include other files, which are edited with it.
"""

import os
import re
from typing import NamedTuple
from xml.parsers import expat

from ftbias_jax.errors import SetupError
from ftbias_jax.setup.fields import read_file
from ftbias_jax.setup.mjcf import Mjcf
from ftbias_jax.setup.urdf import parse_xml
from ftbias_jax.types import Array

MAX_BYTES, MAX_DEPTH = 16 << 20, 128
FILES = ("file", "fileleft", "fileright", "fileup", "filedown", "filefront", "fileback")
"""Attributes of an MJCF that name a file."""


class Element(NamedTuple):
    """One element, and its position in the file."""

    tag: str
    attributes: dict[str, str]
    start: int
    """Byte offset of its <."""
    parent: int
    """Number of its parent element; -1 = none."""


class Document:
    """An XML file that is edited as text; ``text`` is the result.

    Raises:
        SetupError: the file cannot be read, is not XML, defines entities, or is not UTF-8.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.content = read_file(file, MAX_BYTES, "give the path of an XML file", "give an XML file, not a mesh")
        parse_xml(self.content, file, "an XML file", MAX_DEPTH)
        try:
            self.content.decode()
        except UnicodeDecodeError as error:
            raise SetupError(f"is not UTF-8: {error}", file=file, remedy="save it as UTF-8") from error
        self.elements = _elements(self.content)
        self._edits: list[tuple[int, int, str]] = []

    def find(self, tag: str, **attributes: str) -> list[int]:
        """Numbers of the elements with a tag and these attributes."""
        items = attributes.items()
        return [i for i, e in enumerate(self.elements) if e.tag == tag and items <= e.attributes.items()]

    def children(self, parent: int, tag: str) -> list[int]:
        """Numbers of the direct children of an element that have a tag."""
        return [i for i, e in enumerate(self.elements) if e.parent == parent and e.tag == tag]

    def set(self, element: int, name: str, value: str | None) -> None:
        """Set an attribute; None removes it."""
        start, end = self._opening(element)
        pattern = rf"\s{name}\s*=\s*(\"[^\"]*\"|'[^']*')"
        found = re.search(pattern.encode(), self.content[start:end])
        if found:
            new = "" if value is None else f' {name}="{value}"'
            self._edits.append((start + found.start(), start + found.end(), new))
        elif value is not None:
            tag = start + 1 + len(self.elements[element].tag)
            self._edits.append((tag, tag, f' {name}="{value}"'))

    def insert(self, element: int, text: str) -> None:
        """Insert text on a line of its own directly after the opening tag of an element."""
        start, end = self._opening(element)
        line = self.content.rfind(b"\n", 0, start) + 1
        margin = re.match(rb"[ \t]*", self.content[line:start])
        indent = (margin[0] if margin else b"").decode()
        inner = "".join(f"\n{indent}  {part}" for part in text.splitlines())
        if self.content[end - 2 : end] == b"/>":
            tag = self.elements[element].tag
            self._edits.append((end - 2, end, f">{inner}\n{indent}</{tag}>"))
        else:
            self._edits.append((end, end, inner))

    @property
    def text(self) -> str:
        """The edited text."""
        content, last = self.content, len(self.content)
        pieces = list[bytes]()
        for start, end, new in sorted(self._edits, key=lambda edit: edit[0], reverse=True):
            pieces += [content[end:last], new.encode()]
            last = start
        return b"".join([content[:last], *reversed(pieces)]).decode()

    @property
    def changed(self) -> bool:
        """Whether anything was changed."""
        return bool(self._edits)

    def _opening(self, element: int) -> tuple[int, int]:
        """Byte range of an element's opening tag from < to after >, where a > may also occur in attribute values."""
        start = self.elements[element].start
        found = re.compile(rb"<(?:[^>\"']|\"[^\"]*\"|'[^']*')*>").match(self.content, start)
        assert found is not None  # the parser has read it
        return start, found.end()


def _elements(content: bytes) -> list[Element]:
    found, open_ones = list[Element](), [-1]
    parser = expat.ParserCreate()

    def enter(tag: str, attributes: dict[str, str]) -> None:
        found.append(Element(tag, attributes, parser.CurrentByteIndex, open_ones[-1]))
        open_ones.append(len(found) - 1)

    parser.StartElementHandler = enter
    parser.EndElementHandler = lambda _: open_ones.pop() and None
    parser.Parse(content, True)
    return found


class Texts:
    """The documents of which the scene of an MJCF consists; ``output`` is the path of the edited scene."""

    def __init__(self, scene: Mjcf, output: str) -> None:
        self.scene, self.output = scene, output
        self.documents = [Document(scene.file)]
        folder = os.path.dirname(scene.file)
        for document in self.documents:  # the list grows during the loop
            for i in document.find("include"):
                path = os.path.join(folder, document.elements[i].attributes.get("file", ""))
                if path not in {other.file for other in self.documents}:
                    self.documents.append(Document(path))

    def find(self, tag: str, **attributes: str) -> tuple[Document, int] | None:
        """The first element with a tag and these attributes, and its document."""
        return next(((d, i) for d in self.documents for i in d.find(tag, **attributes)), None)

    def body(self, body: int) -> tuple[Document, int] | None:
        """The element of a body, by its name, or for an unnamed sensor body as the parent of the sensor's site."""
        name, site = self.scene.model.body(body).name, self.find("site", name=self.site_name)
        if name or site is None or body != self.scene.body:
            return self.find("body", name=name) if name else None
        return site[0], site[0].elements[site[1]].parent

    @property
    def site_name(self) -> str:
        """Name of the sensor's site."""
        return str(self.scene.model.site(self.scene.site).name)

    @property
    def inertia_from_geoms(self) -> bool:
        """Whether MuJoCo ignores <inertial> elements and takes inertia from geoms."""
        return any(d.elements[i].attributes.get("inertiafromgeom") == "true" for d, i in self.all("compiler"))

    def all(self, tag: str) -> list[tuple[Document, int]]:
        """All elements with a tag, and their documents."""
        return [(document, i) for document in self.documents for i in document.find(tag)]

    def written(self) -> dict[str, str]:
        """Path -> text of the scene and of the changed files that it includes, with file paths for the new place."""
        main, *others = self.documents
        target, stem = os.path.dirname(self.output), os.path.splitext(os.path.basename(self.output))[0]
        copies = {d.file: f"{stem}_{os.path.basename(d.file)}" for d in others if d.changed}
        here, there = (os.path.realpath(folder or ".") for folder in (os.path.dirname(main.file), target))
        for document in [main, *(d for d in others if d.file in copies)] if here != there or copies else []:
            self._move_files(document, here, there, copies)
        written = {self.output: main.text}
        return written | {os.path.join(target, copies[d.file]): d.text for d in others if d.file in copies}

    def _move_files(self, document: Document, here: str, there: str, copies: dict[str, str]) -> None:
        """Rewrite the paths in a document from relative to folder ``here`` to relative to folder ``there``."""
        in_folder = any(
            {"meshdir", "assetdir", "texturedir"} & d.elements[i].attributes.keys() for d, i in self.all("compiler")
        )
        for i, element in enumerate(document.elements):
            names = ("meshdir", "texturedir", "assetdir") if element.tag == "compiler" else FILES
            if element.tag not in ("compiler", "include") and in_folder:
                continue  # relative to those folders
            for name in names:
                path = element.attributes.get(name)
                if path is None or os.path.isabs(path):
                    continue
                full = os.path.join(here, path)
                copy = copies.get(os.path.join(os.path.dirname(self.scene.file), path))
                new = copy if element.tag == "include" and copy else os.path.relpath(full, there)
                if new != path:
                    document.set(i, name, new)


def numbers(values: Array) -> str:
    """Numbers as text of an attribute, with twelve digits and without minus zero."""
    return " ".join(f"{float(f'{value:.12g}') + 0.0:.12g}" for value in values)
