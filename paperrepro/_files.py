"""Files that appear all together, or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from paperrepro.errors import BadInput


@contextmanager
def written_whole(folder: Path) -> Iterator[Path]:
    """A folder to write into; its files move to ``folder`` once the block ends without an error.

    ``folder`` is made; after an error nothing of the block is left, nor the folder if it is new.
    Raises `BadInput` where it cannot be written.
    """
    folder = Path(folder)
    made = next((p for p in [*reversed(folder.parents), folder] if not p.exists()), None)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
    except OSError as error:
        raise BadInput(f"{folder}: cannot be written ({error.strerror}); name another") from error
    try:
        yield draft
        for path in sorted(draft.iterdir()):
            os.replace(path, folder / path.name)
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        _remove_empty(folder, made)
        raise
    shutil.rmtree(draft)


def _remove_empty(folder: Path, made: Path | None) -> None:
    """Folders that were made and hold nothing, from ``folder`` up to ``made``."""
    for path in [folder, *folder.parents] if made else []:
        try:
            path.rmdir()
        except OSError:
            return
        if path == made:
            return
