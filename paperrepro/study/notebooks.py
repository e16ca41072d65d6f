"""Notebooks as programs: the parameters that they declare, and one execution of them."""

import ast
import contextlib
import logging
import os
import shutil
import signal
import tempfile
import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat
import papermill
from jupyter_client.manager import AsyncKernelManager
from nbformat import NotebookNode
from papermill.exceptions import PapermillExecutionError
from traitlets import default

from paperrepro._files import write_text
from paperrepro.errors import BadInput, PaperReproError

#: Parameter that names the folder of results; empty: nothing is written.
OUTPUT = "figures_dir"
#: Bytes of a folder's path that leave room for a socket's name; the system ends at 107.
_LONGEST_FOLDER = 80
_PLAIN = (int, float, str, bool)
#: Characters of one output that are kept of a run among many.
_LONGEST_OUTPUT = 20_000


class NotebookFailed(PaperReproError):
    """A notebook ended with an error: in the cell of index ``cell``, with ``reason`` in a line."""

    def __init__(self, name: str, cell: int | None, reason: str, hint: str = ""):
        self.cell, self.reason = cell, reason
        super().__init__(f"{name}, cell {cell}: {reason}{hint}")


@dataclass(frozen=True)
class Parameter:
    """A parameter that a notebook declares: a plain scalar and its type."""

    name: str
    kind: type
    default: Any

    def __str__(self) -> str:
        return f"{self.name}: {self.kind.__name__} = {self.default!r}"


class LocalKernelManager(AsyncKernelManager):
    """Talks to the kernel through files of this user instead of network ports."""

    @default("transport")
    def _default_transport(self) -> str:
        return "ipc"

    @default("ip")
    def _default_ip(self) -> str:
        """A name that no other kernel has; by default they would meet in the current folder."""
        usual = tempfile.gettempdir()
        folder = tempfile.mkdtemp(
            prefix="kernel-", dir=usual if len(os.fsencode(usual)) <= _LONGEST_FOLDER else "/tmp"
        )
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        return str(Path(folder) / "ipc")

    def format_kernel_cmd(self, extra_arguments: list[str] | None = None) -> list[str]:
        """Linux ends the kernel with the thread that started it, however that ends."""
        command = super().format_kernel_cmd(extra_arguments)
        tool = shutil.which("setpriv")
        return [tool, "--pdeathsig", "KILL", *command] if tool else command

    async def _async_interrupt_kernel(self) -> None:
        """Not when it is asked to end anyway: a kernel that is about to be idle would report the
        interruption as an error."""
        if not self.shutting_down:
            await super()._async_interrupt_kernel()

    def kill(self) -> None:
        """End the kernel, and what it started, at once."""
        process = getattr(self.provisioner, "process", None)
        if process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def declared(notebook: Path) -> dict[str, Parameter]:
    """Parameters of ``notebook`` by name, in their order; papermill only warns about others.

    Raises `BadInput` where there is no such notebook, or a default is no plain scalar.
    """
    try:
        found = papermill.inspect_notebook(str(notebook))
    except (OSError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise BadInput(f"{notebook}: expected a notebook, got: {reason}; check its name") from None
    return {name: _parameter(notebook, **about) for name, about in found.items()}


def _parameter(
    notebook: Path, name: str, inferred_type_name: str, default: str, **_: str
) -> Parameter:
    kinds = {kind.__name__: kind for kind in _PLAIN}
    try:
        value = ast.literal_eval(default)
        kind = kinds.get(inferred_type_name, type(value))
        if kind not in _PLAIN:
            raise ValueError(kind)
    except (ValueError, SyntaxError):
        raise BadInput(
            f"{notebook.name}: parameter {name}: expected a number, a text or a truth value, "
            f"got {default}; make it plain in the cell tagged parameters"
        ) from None
    return Parameter(name, kind, float(value) if kind is float else value)


def shortened(book: NotebookNode) -> NotebookNode:
    """``book`` with what it has printed cut to a length that a folder of thousands can bear."""
    for cell in book.cells:
        for output in cell.get("outputs", ()):
            if len(text := output.get("text", "")) > _LONGEST_OUTPUT:
                cut = f"\n[{len(text) - _LONGEST_OUTPUT} characters more]\n"
                output["text"] = text[:_LONGEST_OUTPUT] + cut
    return book


def without_outputs(notebook: Path) -> str:
    """The text of ``notebook``, without what it has shown when it was executed."""
    book = nbformat.read(notebook, as_version=4)
    for cell in book.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    return nbformat.writes(book)


def execute(
    notebook: Path | NotebookNode, target: Path, parameters: Mapping,
    km: LocalKernelManager, hint: str = "", **engine,
) -> None:  # fmt: skip
    """Run ``notebook`` with ``parameters`` into ``target`` on the running kernel of ``km``.

    Raises `NotebookFailed`, which ends with ``hint``; ``target`` then holds it as far as it ran.
    """
    logging.getLogger("papermill").setLevel(logging.CRITICAL)  # what fails is raised
    source = notebook if isinstance(notebook, NotebookNode) else str(notebook)
    try:
        papermill.execute_notebook(
            source, str(target), dict(parameters), kernel_name="python3", progress_bar=False,
            km=km, **engine,
        )  # fmt: skip
    except PapermillExecutionError as error:
        reason = f"{error.ename}: {error.evalue}"
        raise NotebookFailed(target.name, error.cell_index, reason, hint) from None


def as_page(notebook: Path) -> None:
    """Write an executed ``notebook`` beside itself as a page of HTML, its pictures in it."""
    import nbconvert  # takes a second, which a run of a sweep need not spend

    body, _ = nbconvert.HTMLExporter().from_filename(str(notebook))
    write_text(notebook.with_suffix(".html"), body)
