"""Files that appear whole or not at all: one alone, or those of a folder together.

A process that is killed leaves a draft; whoever writes there next clears it away.
"""

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from paperrepro.errors import BadInput

_DRAFT, _LOCK = ".unfinished-", ".unfinished.lock"
_NEW, _OLD = "new", "old"


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A name to write to; that file replaces ``path`` once the block ends without an error."""
    part = Path(path).with_name(f"{Path(path).name}.part")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """The file, UTF-8, whole or not at all; what is no character (a name of other bytes) as ?."""
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8", errors="replace", newline="\n")


@contextmanager
def written_whole(folder: Path, replace: bool = True) -> Iterator[Path]:
    """A folder to write into; its files, in folders too, replace those of ``folder`` once the block
    ends without an error: all of them, or none.

    ``folder`` is made; after an error nothing of the block is left, nor the folder if it is new.
    Raises `BadInput` where it cannot be written, another process is writing there, or a file would
    be replaced against ``replace``.
    """
    folder = Path(folder)
    made = next((p for p in [*reversed(folder.parents), folder] if not p.exists()), None)
    with _alone(folder, made):
        draft = Path(tempfile.mkdtemp(prefix=_DRAFT, dir=folder))
        try:
            (draft / _NEW).mkdir()
            yield draft / _NEW
            there = sorted(p.name for p in (draft / _NEW).iterdir() if (folder / p.name).exists())
            if there and not replace:
                raise BadInput(
                    f"{folder}: holds {', '.join(there)} already; name another folder, or give "
                    "--force to replace them"
                )
            _replace_all(draft, folder)
        except BaseException:
            if not (draft / _OLD).exists():  # else the next start finishes it
                shutil.rmtree(draft, ignore_errors=True)
            raise
        shutil.rmtree(draft, ignore_errors=True)


def require_folder(folder: Path) -> None:
    """Make ``folder``. Raises `BadInput` where that, or a file in it, cannot be made."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise _unwritable(folder, error) from error


@contextmanager
def _alone(folder: Path, made: Path | None) -> Iterator[None]:
    """``folder`` for this process, without what others left that were killed."""
    lock = FileLock(folder / _LOCK)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=0)
    except Timeout:
        raise BadInput(
            f"{folder}: another command is writing here; wait for it, or name another folder"
        ) from None
    except OSError as error:
        _remove_empty(folder, made)
        raise _unwritable(folder, error) from error
    try:
        for draft in folder.glob(f"{_DRAFT}*"):
            if (draft / _OLD).exists():  # all was written, and part of it in place already
                _replace_all(draft, folder)
            shutil.rmtree(draft, ignore_errors=True)
        yield
    finally:
        with suppress(OSError):
            (folder / _LOCK).unlink(missing_ok=True)
        lock.release()
        _remove_empty(folder, made)


def _replace_all(draft: Path, folder: Path) -> None:
    """Move the new files of ``draft`` into ``folder``, the old ones into the draft; where one of
    them cannot be moved, or a signal ends it, all are as before."""
    new, old, begun = draft / _NEW, draft / _OLD, []
    old.mkdir(exist_ok=True)
    try:
        for path in sorted(path for path in new.rglob("*") if path.is_file()):
            target, kept = folder / path.relative_to(new), old / path.relative_to(new)
            for place in (target, kept):
                place.parent.mkdir(parents=True, exist_ok=True)
            if target.is_dir():
                raise IsADirectoryError(None, "a folder has this name")
            begun.append((path, target, kept))
            if os.path.lexists(target):
                os.replace(target, kept)
            os.replace(path, target)
    except BaseException as error:
        for path, moved, kept in reversed(begun):
            if not os.path.lexists(path):
                os.replace(moved, path)
            if os.path.lexists(kept):
                os.replace(kept, moved)
            if moved.parent != folder:
                with suppress(OSError):
                    moved.parent.rmdir()
        if not any(path.is_file() for path in old.rglob("*")):
            shutil.rmtree(old)
        if not isinstance(error, OSError):
            raise
        raise BadInput(
            f"{target}: cannot be replaced ({error.strerror}), so nothing was written; free it or "
            "name another folder"
        ) from error


def _unwritable(folder: Path, error: OSError) -> BadInput:
    return BadInput(f"{folder}: cannot be written ({error.strerror}); name another folder")


def _remove_empty(folder: Path, made: Path | None) -> None:
    """Folders that were made and hold nothing, from ``folder`` up to ``made``."""
    for path in [folder, *folder.parents] if made else []:
        try:
            path.rmdir()
        except OSError:
            return
        if path == made:
            return


def private_folder(folder: Path, entries: str = "**/*") -> bool:
    """Whether ``folder``, made if it is not there, is the user's own, and nobody else's business.

    Pickles are run when they are read, so a folder that others could write into is not read: where
    it is ours, the files like ``entries`` in it are removed and it is closed to others.
    """
    folder = Path(folder)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.lstat()
        if not stat.S_ISDIR(state.st_mode) or not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
            return False
        if os.name == "nt":
            return True
        if state.st_uid != os.geteuid():
            return False
        if state.st_mode & 0o077:
            for path in folder.glob(entries):
                if path.is_file():
                    path.unlink()
            folder.chmod(0o700)
    except (OSError, RuntimeError):
        return False
    return True
