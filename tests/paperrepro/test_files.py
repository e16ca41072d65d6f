"""Files appear whole, all together, or not at all; what was left is cleared by the next one."""

import os
import signal
import subprocess
import sys
from contextlib import suppress

import pytest

from paperrepro._files import require_folder, whole_file, written_whole
from paperrepro.errors import BadInput


def names(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def write(folder, text, *files):
    for name in files:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)


def fill(folder, *files, then=None):
    with written_whole(folder) as draft:
        write(draft, "new", *files)
        if then:
            raise then


def test_all_files_are_replaced_together(tmp_path):
    write(tmp_path, "old", "a", "kept")
    with written_whole(tmp_path) as draft:
        write(draft, "new", "a", "b", "below/c")
        assert (tmp_path / "a").read_text() == "old"
    assert names(tmp_path) == ["a", "b", "below/c", "kept"]
    assert (tmp_path / "a").read_text() == "new"


def test_where_one_cannot_be_replaced_none_is(tmp_path):
    """The last of three is a folder; the first two were moved already."""
    write(tmp_path, "old", "a")
    (tmp_path / "c").mkdir()
    with pytest.raises(BadInput, match=r"/c: cannot be replaced .*nothing was written"):
        fill(tmp_path, "a", "b", "c")
    assert names(tmp_path) == ["a"]
    assert (tmp_path / "a").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "c"]


def test_after_an_error_nothing_is_left_nor_the_folder(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fill(tmp_path / "new" / "below", "a", then=ZeroDivisionError)
    assert not list(tmp_path.iterdir())


def test_two_do_not_write_into_one_folder(tmp_path):
    with written_whole(tmp_path) as draft:
        write(draft, "first", "a")
        with pytest.raises(BadInput, match="another command is writing here"):
            fill(tmp_path, "b")
    assert names(tmp_path) == ["a"]


def test_what_cannot_be_a_folder_is_refused(tmp_path):
    write(tmp_path, "a file", "a")
    for path in (tmp_path / "a", tmp_path / "a" / "b"):
        with pytest.raises(BadInput, match="cannot be written"):
            fill(path, "b")
        with pytest.raises(BadInput, match="cannot be written"):
            require_folder(path)


def test_a_file_is_replaced_whole(tmp_path):
    for then, text in ((ZeroDivisionError, None), (None, "new")):
        (tmp_path / "a").write_text("old")
        with suppress(ZeroDivisionError), whole_file(tmp_path / "a") as part:
            part.write_text("new")
            if then:
                raise then
        assert (tmp_path / "a").read_text() == (text or "old")
    assert names(tmp_path) == ["a"]


WRITER = """
import sys, time
from pathlib import Path
from paperrepro import _files
move, done = _files.os.replace, []
def replace(one, other):
    move(one, other)
    done.append(other)
    if len(done) == int(sys.argv[2]):  # one file is in place
        print("moved", flush=True)
        time.sleep(60)
_files.os.replace = replace
with _files.written_whole(Path(sys.argv[1])) as draft:
    (draft / "a").write_text("new")
    (draft / "b").write_text("new")
    if int(sys.argv[2]) == 0:
        print("written", flush=True)
        time.sleep(60)
"""


@pytest.mark.parametrize(("moves", "left"), [(0, "old"), (2, "new"), (3, "new")])
def test_what_a_killed_process_left_is_cleared_by_the_next(tmp_path, moves, left):
    """Killed while it writes, nothing has happened; while it moves, all of it has."""
    write(tmp_path, "old", "a", "b")
    command = [sys.executable, "-c", WRITER, str(tmp_path), str(moves)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.stdout.readline()
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(os.listdir(tmp_path)) > 2
    with written_whole(tmp_path) as draft:
        write(draft, "next", "c")
        assert {(tmp_path / name).read_text() for name in "ab"} == {left}
    assert names(tmp_path) == ["a", "b", "c"]


@pytest.mark.parametrize("after", ["rename of the old", "rename of the new"])
def test_files_of_before_are_there_again_after_a_signal(tmp_path, after):
    """While results take their places."""
    code = f"""
import os, sys
from pathlib import Path
from paperrepro._files import written_whole
out, seen = Path(sys.argv[1]), []
def look(event, about):
    if event == "os.rename" and (seen.append(about) or len(seen) == {3 + after.endswith("new")}):
        raise KeyboardInterrupt
sys.addaudithook(look)
with written_whole(out) as draft:
    for name in "abc":
        (draft / name).write_text("new")
"""
    out = tmp_path / "out"
    out.mkdir()
    for name in "abc":
        (out / name).write_text("old")
    done = subprocess.run([sys.executable, "-c", code, str(out)], capture_output=True, text=True)
    assert "KeyboardInterrupt" in done.stderr
    assert {path.name: path.read_text() for path in out.iterdir()} == dict.fromkeys("abc", "old")


def test_what_is_there_stays_where_it_must_not_be_replaced(tmp_path):
    (tmp_path / "one").write_text("old")

    def write():
        with written_whole(tmp_path, replace=False) as draft:
            (draft / "one").write_text("new")
            (draft / "two").write_text("new")

    with pytest.raises(BadInput, match=r"holds one already; .*--force"):
        write()
    assert [path.name for path in tmp_path.iterdir()] == ["one"]
    assert (tmp_path / "one").read_text() == "old"
