"""The text of an MJCF and of what it includes: where its elements stand, and how it is written elsewhere."""

import os

from ftbias_jax.setup.mjcf import Mjcf
from ftbias_jax.simulators.xml_text import Document

FILES = ("file", "fileleft", "fileright", "fileup", "filedown", "filefront", "fileback")
"""Attributes that name a file."""


class Texts:
    """The documents that a scene is made of."""

    def __init__(self, scene: Mjcf, output: str) -> None:
        """Read them.

        Args:
            scene: as it is.
            output: where the changed scene will be.
        """
        self.scene, self.output = scene, output
        self.documents = [Document(scene.file)]
        folder = os.path.dirname(scene.file)
        for document in self.documents:  # grows on the way
            for i in document.find("include"):
                path = os.path.join(folder, document.elements[i].attributes.get("file", ""))
                if path not in {other.file for other in self.documents}:
                    self.documents.append(Document(path))

    def find(self, tag: str, **attributes: str) -> tuple[Document, int] | None:
        """The first element of a tag with these attributes."""
        return next(((d, i) for d in self.documents for i in d.find(tag, **attributes)), None)

    def body(self, body: int) -> tuple[Document, int] | None:
        """The element of a body: by its name, or as what the sensor's site is in."""
        name, site = self.scene.model.body(body).name, self.find("site", name=self.site_name)
        if name or site is None or body != self.scene.body:
            return self.find("body", name=name) if name else None
        return site[0], site[0].elements[site[1]].parent

    @property
    def site_name(self) -> str:
        """Of the sensor."""
        return str(self.scene.model.site(self.scene.site).name)

    @property
    def inertia_from_geoms(self) -> bool:
        """Whether an <inertial> counts for nothing."""
        return any(d.elements[i].attributes.get("inertiafromgeom") == "true" for d, i in self.all("compiler"))

    def all(self, tag: str) -> list[tuple[Document, int]]:
        """Every element of a tag."""
        return [(document, i) for document in self.documents for i in document.find(tag)]

    def written(self) -> dict[str, str]:
        """Path -> text of the scene and of what it includes and was changed; all with the paths that hold there."""
        main, *others = self.documents
        target, stem = os.path.dirname(self.output), os.path.splitext(os.path.basename(self.output))[0]
        copies = {d.file: f"{stem}_{os.path.basename(d.file)}" for d in others if d.changed}
        here, there = (os.path.realpath(folder or ".") for folder in (os.path.dirname(main.file), target))
        for document in [main, *(d for d in others if d.file in copies)] if here != there or copies else []:
            self._move_files(document, here, there, copies)
        written = {self.output: main.text}
        return written | {os.path.join(target, copies[d.file]): d.text for d in others if d.file in copies}

    def _move_files(self, document: Document, here: str, there: str, copies: dict[str, str]) -> None:
        """Paths in a document, relative to one folder, as they are from another."""
        in_folder = any(
            {"meshdir", "assetdir", "texturedir"} & d.elements[i].attributes.keys() for d, i in self.all("compiler")
        )
        for i, element in enumerate(document.elements):
            names = ("meshdir", "texturedir", "assetdir") if element.tag == "compiler" else FILES
            if element.tag not in ("compiler", "include") and in_folder:
                continue  # found from those folders
            for name in names:
                path = element.attributes.get(name)
                if path is None or os.path.isabs(path):
                    continue
                full = os.path.join(here, path)
                copy = copies.get(os.path.join(os.path.dirname(self.scene.file), path))
                new = copy if element.tag == "include" and copy else os.path.relpath(full, there)
                if new != path:
                    document.set(i, name, new)
