from __future__ import annotations

from pathlib import Path

import pytest

from torch_activegp.cli.folders import check_free, next_free, results_in
from torch_activegp.errors import ConfigurationError


def test_the_next_free_name_has_the_lowest_number(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "arm"
    assert next_free(folder) == folder
    for name in ("arm", "arm-2", "arm-4"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    assert next_free(folder) == tmp_path / "runs" / "arm-3"
    assert next_free(folder, lambda path: path.name == "arm-2") == tmp_path / "runs" / "arm-2"
    assert next_free(folder, lambda path: path.name == "arm-4") == tmp_path / "runs" / "arm-3"


def test_other_files_do_not_matter_but_earlier_results_do(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    check_free(tmp_path, ["corrected*", "next.csv"])
    check_free(tmp_path / "new" / "deep", ["corrected*"])
    (tmp_path / "corrected.xml").touch()
    with pytest.raises(ConfigurationError, match=r"holds earlier results \(corrected.xml\), which are never overwrit"):
        check_free(tmp_path, ["corrected*", "next.csv"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["corrected.xml", "notes.txt"]


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    with pytest.raises(ConfigurationError, match="Wanted a folder for the output, found the file"):
        check_free(tmp_path / "a", [])
    with pytest.raises(ConfigurationError, match="a is a file"):
        check_free(tmp_path / "a" / "b", [])
    with (
        pytest.raises(ConfigurationError, match="Cannot write to .*: Not a directory"),
        results_in(tmp_path / "a" / "b"),
    ):
        pass


def test_a_folder_that_cannot_be_written_is_said_before_the_work(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.cli.folders.os.access", lambda *_: False)
    with pytest.raises(ConfigurationError, match="cannot be written. Choose another --out"):
        check_free(tmp_path, [])


def test_a_folder_is_made_with_those_above(tmp_path: Path) -> None:
    for _ in range(2):
        with results_in(tmp_path / "a" / "b"):
            assert (tmp_path / "a" / "b").is_dir()


def test_a_full_disk_is_one_message(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="Cannot write to .*: No space left"), results_in(tmp_path):
        raise OSError(28, "No space left on device")
