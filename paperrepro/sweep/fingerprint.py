"""What the rows of a run depend on beside its parameters: rows of two versions never mix."""

import platform
import re
from dataclasses import dataclass

import joblib
import nbformat

from paperrepro.cache import code_version_of
from paperrepro.environment import package_versions


@dataclass(frozen=True)
class Fingerprint:
    """Hashes of the notebook's code and of our modules that it uses; versions of Python and of the
    packages that the project asks for."""

    notebook: str
    code: str
    packages: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, notebook: str) -> "Fingerprint":
        """Of the text of a notebook, where this process runs; what is on disk is read anew."""
        cells = nbformat.reads(notebook, as_version=4).cells
        sources = [cell.source for cell in cells if cell.cell_type == "code"]
        plain = re.sub(r"^\s*[%!].*$", "", "\n".join(sources), flags=re.MULTILINE)
        versions = {"Python": platform.python_version(), **package_versions()}
        return cls(joblib.hash(sources), code_version_of(plain), tuple(versions.items()))

    def __str__(self) -> str:
        return joblib.hash((self.notebook, self.code, self.packages))

    def told(self) -> dict:
        """For the files that a sweep leaves."""
        return {"fingerprint": str(self), "packages": dict(self.packages)}

    def differs_in(self, other: "Fingerprint") -> str:
        """What is not the same, in words; empty if all is."""
        words = [
            part for part in ("notebook", "code") if getattr(self, part) != getattr(other, part)
        ]
        ours, theirs = dict(self.packages), dict(other.packages)
        words += [
            f"{name} {theirs.get(name, 'missing')} instead of {ours.get(name, 'none')}"
            for name in {**ours, **theirs}
            if ours.get(name) != theirs.get(name)
        ]
        return ", ".join(words)
