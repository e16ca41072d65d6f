"""A kernel that executes one notebook after another, so that packages are imported once.

Each notebook finds an empty namespace, as in a new kernel. A kernel that a notebook failed in is
not used again, nor one that another run started, whose code may be older.
"""

import asyncio
import atexit
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

import psutil
from jupyter_core.utils import ensure_event_loop, run_sync
from nbformat import NotebookNode

from paperrepro.study.notebooks import LocalKernelManager, execute

_START_S = 120
_LOOK_S = 0.25  # between two looks at a kernel's memory
_of_thread = threading.local()
_running: "set[Kernel]" = set()
_loops: set[asyncio.AbstractEventLoop] = set()


class _Manager(LocalKernelManager):
    """Knows its clients: papermill leaves open what it has of a kernel that is not its own."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self._clients = []

    def client(self, **kwargs):
        self._clients.append(super().client(**kwargs))
        return self._clients[-1]

    def close_clients(self) -> None:
        while self._clients:
            self._clients.pop().stop_channels()


class Kernel:
    """A running kernel for one ``run``, a sweep for example; it has ``variables`` beside those of
    this process."""

    def __init__(self, run: str, variables: Mapping[str, str]):
        self.run = run
        self.ended_for = ""
        self._manager = _Manager(kernel_name="python3")
        _loops.add(ensure_event_loop())
        run_sync(self._manager.start_kernel)(env={**os.environ, **variables})
        _running.add(self)

    def execute(
        self, notebook: Path | NotebookNode, target: Path, parameters: Mapping,
        most: int | None = None, hint: str = "",
    ) -> None:  # fmt: skip
        """As `paperrepro.study.notebooks.execute`; ends the kernel where that fails, or takes more
        than ``most`` bytes, which `ended_for` then says."""
        try:
            with self._bounded(most):
                execute(notebook, target, parameters, self._manager, hint, start_timeout=_START_S)
                run_sync(self._forget)()
        except BaseException:
            self.stop()
            raise
        finally:
            self._manager.close_clients()

    @contextmanager
    def _bounded(self, most: int | None) -> Iterator[None]:
        over = threading.Event()

        def watch(kernel: psutil.Process) -> None:
            while most and not over.wait(_LOOK_S) and kernel.is_running():
                if kernel.memory_info().rss > most:
                    self.ended_for = f"it took more than the {most / 2**30:.1f} GiB of its worker"
                    self._manager.kill()

        kernel = psutil.Process(self._manager.provisioner.process.pid)
        threading.Thread(target=watch, args=[kernel], daemon=True).start()
        try:
            yield
        finally:
            over.set()

    async def _forget(self) -> None:
        client = self._manager.client()
        client.start_channels()
        await client.execute(
            "%reset -f", silent=True, store_history=False, reply=True, timeout=_START_S
        )

    @property
    def runs(self) -> bool:
        return self in _running

    def stop(self) -> None:
        """End it and what it started at once; may be called from any thread, and twice."""
        if self in _running:
            _running.discard(self)
            self._manager.kill()
            self._manager.cleanup_connection_file()


def kernel_for(
    run: str, before_start: Callable[[], None] = lambda: None,
    variables: Mapping[str, str] = MappingProxyType({}),
) -> Kernel:  # fmt: skip
    """The kernel of this thread for ``run``; started anew with ``variables``, after
    ``before_start`` was called, where there is none."""
    kernel = getattr(_of_thread, "kernel", None)
    if kernel is None or not kernel.runs or kernel.run != run:
        if kernel is not None:
            kernel.stop()
        before_start()
        kernel = _of_thread.kernel = Kernel(run, variables)
    return kernel


def stop_kernels(run: str | None = None) -> None:
    """End the kernels of ``run``, or all, of this process."""
    for kernel in list(_running):
        if run in (None, kernel.run):
            kernel.stop()


@atexit.register
def _end() -> None:
    """Loops are closed too: an open one that is collected after its sockets prints a traceback. One
    that another thread runs to the last cannot be; what it has to say then concerns nobody."""
    stop_kernels()
    sys.unraisablehook = lambda _: None
    for loop in _loops:
        if not loop.is_running():
            loop.close()
