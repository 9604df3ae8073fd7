from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from torch_activegp.files import written_whole


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "a.txt"
    path.write_text("earlier")
    return path


@pytest.fixture(params=[0o022, 0o077])
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_a_file_takes_its_name_when_it_is_whole(path: Path) -> None:
    with written_whole(path) as file:
        file.write(b"new")
        assert path.read_text() == "earlier"
    assert path.read_bytes() == b"new"
    assert os.listdir(path.parent) == ["a.txt"]


def test_what_is_written_can_be_read_before_it_counts(path: Path) -> None:
    with written_whole(path) as file:
        file.write(b"new")
        file.seek(0)
        assert file.read() == b"new"


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt(), ValueError()])
def test_a_failure_in_the_middle_leaves_the_earlier_file(path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)) as raised, written_whole(path) as file:
        file.write(b"half")
        file.flush()
        assert len(os.listdir(path.parent)) == 2
        raise error
    assert raised.value is error
    assert path.read_text() == "earlier"
    assert os.listdir(path.parent) == ["a.txt"]


@pytest.mark.parametrize("where", ["os.fsync", "os.replace"])
def test_a_failure_at_the_end_leaves_the_earlier_file(path: Path, where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(where, fail)
    with pytest.raises(OSError, match="No space left"), written_whole(path) as file:
        file.write(b"new")
    assert path.read_text() == "earlier"
    assert os.listdir(path.parent) == ["a.txt"]


@pytest.mark.parametrize("folder", ["a.txt", "missing"])
def test_a_folder_that_is_none_is_said_once(path: Path, folder: str) -> None:
    place = path.parent / folder / "b.txt"
    with pytest.raises(OSError, match="Not a directory" if folder == "a.txt" else "No such file") as raised:
        with written_whole(place):
            raise AssertionError("nothing to write to")
    assert raised.value.__context__ is None


def test_two_writers_at_once_do_not_meet(path: Path) -> None:
    with written_whole(path) as first:
        with written_whole(path) as second:
            first.write(b"first")
            second.write(b"second")
        assert path.read_bytes() == b"second"
    assert path.read_bytes() == b"first"


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_the_permissions_are_what_the_umask_gives(tmp_path: Path, umask: int) -> None:
    with written_whole(tmp_path / "new"):
        pass
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o666 & ~umask
