from __future__ import annotations

import hashlib
from pathlib import Path

import pooch
import pytest

from torch_activegp.data import public
from torch_activegp.data.public import DATA_VARIABLE, PUBLIC_FILES, PublicFile, fetch, url
from torch_activegp.errors import DataError

CONTENT = b"recorded"


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> str:
    """A public file whose content is known here, and a cache of its own."""
    name = "set/file.mat"
    entry = PublicFile("owner/repository/commit/folder", "MIT", hashlib.sha256(CONTENT).hexdigest())
    monkeypatch.setitem(PUBLIC_FILES, name, entry)
    monkeypatch.setattr(pooch, "os_cache", lambda project: tmp_path / "cache" / project)
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    return name


def serve(monkeypatch: pytest.MonkeyPatch, content: bytes | OSError) -> list[str]:
    """Replace the network: each download writes ``content`` or raises it; returns the list of addresses asked for."""
    asked: list[str] = []

    def download(address: str, output_file: str, downloader: object) -> None:
        asked.append(address)
        if isinstance(content, OSError):
            raise content
        Path(output_file).write_bytes(content)

    def choose(address: str, progressbar: bool = False) -> object:
        return download

    monkeypatch.setattr("pooch.core.choose_downloader", choose)
    return asked


def save(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes) -> Path:
    path = tmp_path / "data" / name
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "data"))
    return path


def test_every_entry_is_pinned_to_a_commit_and_a_checksum() -> None:
    for name, entry in PUBLIC_FILES.items():
        assert len(bytes.fromhex(entry.sha256)) == 32
        owner, repository, commit, *folder = entry.folder.split("/")
        assert owner and repository and len(bytes.fromhex(commit)) == 20 and folder
        assert url(name) == f"https://raw.githubusercontent.com/{entry.folder}/{Path(name).name}"


def test_the_folder_serves_first(known: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = serve(monkeypatch, CONTENT)
    path = save(tmp_path, monkeypatch, known, CONTENT)
    assert fetch(known) == path
    assert asked == []


def test_an_altered_file_in_the_folder_is_refused(known: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    save(tmp_path, monkeypatch, known, CONTENT + b"!")
    with pytest.raises(DataError, match=r"file.mat: sha256 \w{64} wanted, found \w{64}. .*fetch it again"):
        fetch(known)


@pytest.mark.parametrize("folder", [None, "empty"])
def test_the_network_serves_once(
    known: str, folder: str | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if folder:
        monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / folder))
    asked = serve(monkeypatch, CONTENT)
    path = fetch(known)
    assert path.read_bytes() == CONTENT
    assert path.parent == tmp_path / "cache" / "torch-activegp"
    assert fetch(known) == path
    assert asked == ["https://raw.githubusercontent.com/owner/repository/commit/folder/file.mat"]


def test_an_altered_download_is_refused(known: str, monkeypatch: pytest.MonkeyPatch) -> None:
    serve(monkeypatch, b"something else")
    with pytest.raises(
        DataError, match="set/file.mat: TORCH_ACTIVEGP_DATA is not set, and the download failed: .*SHA256"
    ):
        fetch(known)


def test_without_folder_and_network_it_says_what_to_do(known: str, monkeypatch: pytest.MonkeyPatch) -> None:
    serve(monkeypatch, ConnectionError("no route"))
    monkeypatch.setenv(DATA_VARIABLE, "elsewhere")
    wanted = (
        "not in TORCH_ACTIVEGP_DATA=elsewhere, and the download failed: no route. Connect to the network, "
        f"or save {url(known)} as `set/file.mat` in a folder"
    )
    with pytest.raises(DataError, match=wanted):
        fetch(known)


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(DataError, match="no public file `emps`: one of emps/DATA_EMPS.mat"):
        fetch("emps")


@pytest.mark.parametrize("name", PUBLIC_FILES)
def test_the_real_files_have_these_checksums(recordings_dir: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(public.pooch, "retrieve", None)
    assert fetch(name) == recordings_dir / name
