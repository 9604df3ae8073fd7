"""Public recordings of real hardware: fetched from their authors' repositories, checked, never redistributed."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from pathlib import Path

import pooch

from torch_activegp.errors import DataError

DATA_VARIABLE = "TORCH_ACTIVEGP_DATA"
"""Environment variable: a folder that serves the files (``emps/DATA_EMPS.mat``, ...) instead of the network."""

_EMPS = "forgi86/sysid-neural-continuous/956aa7ecd73061b0321c6f6098d74c9e4a7ce67a/examples/EMPS/data"
_PENDULUM = "dynamicslab/MultiArm-Pendulum/e99a7e13fe2adc8fc647321a156b6cb59a48a698/ParameterEstimation/SinglePendulum"
_LAAS = "heitor-andrade/laas_anti_cogging/eb0391d736f1aaaf6cb0c72ea5a9b5c1350284c4/codes"
_BALLS = "briandesilva/discovery-of-physics-from-data/b79c34317f049c9b47aaf2cc4c54c5ec7219f3d7/data"


@dataclasses.dataclass(frozen=True)
class PublicFile:
    """One file: where it comes from (repository, commit and folder), its licence, and its checksum."""

    folder: str
    licence: str
    sha256: str


PUBLIC_FILES = {
    "emps/DATA_EMPS.mat": PublicFile(
        _EMPS,
        "Apache-2.0; cite nonlinearbenchmark.org",
        "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",
    ),
    "emps/DATA_EMPS_PULSES.mat": PublicFile(
        _EMPS,
        "Apache-2.0; cite nonlinearbenchmark.org",
        "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704",
    ),
    "multiarm_single/SinglePendulumDataForParameterEstimation.mat": PublicFile(
        _PENDULUM, "MIT", "f3b8cdda4a6e86405ec37ff32b98be76fd37806a609cba7870628c1e40377a98"
    ),
    "multiarm_single/EstimatedParameters_SinglePendulum.mat": PublicFile(
        _PENDULUM, "MIT", "64108f0f69a202f8893a376bd87b69cd54ed13664aed33db085766639a5b0962"
    ),
    "laas_cogging/acc_current.txt": PublicFile(
        f"{_LAAS}/done/acceleration_data",
        "BSD-3-Clause",
        "dac1afeec1bf10f20e69a5d4e3e6a6be2b20a5c7eb2a5b7773ed9d4e3322cf57",
    ),
    "laas_cogging/speed_test.txt": PublicFile(
        f"{_LAAS}/Testing/speed_data",
        "BSD-3-Clause",
        "0e92a000db264e76a871fa92989fc657c819dd42219823daab1bbc453e300d73",
    ),
    "laas_cogging/speed_test1.txt": PublicFile(
        f"{_LAAS}/Testing/speed_data",
        "BSD-3-Clause",
        "b098ab15e4f503952e62aad85d57ffd4cc58b4f7e0610aba09c7b61e54d5ea3f",
    ),
    "balls/Ball_drops_data.xls": PublicFile(
        _BALLS, "MIT", "942b2d68abfff3828ca323de491435d4ec27c3a22e62cee0cbdf52c2e8d1c0ed"
    ),
}
"""Every public file that this package knows, by the name that :func:`fetch` takes."""


def url(name: str) -> str:
    """Return the address of a public file: the raw content of one commit of its authors' repository.

    Raises:
        DataError: if there is no public file of that name.
    """
    if name not in PUBLIC_FILES:
        raise DataError(f"no public file `{name}`: one of {', '.join(PUBLIC_FILES)} wanted.")
    return f"https://raw.githubusercontent.com/{PUBLIC_FILES[name].folder}/{name.rpartition('/')[2]}"


def fetch(name: str) -> Path:
    """Return the local path of a public file, after its checksum has been checked.

    The folder that ``TORCH_ACTIVEGP_DATA`` names is looked in first; what is not there is downloaded once into the
    user's cache.

    Args:
        name: one of :data:`PUBLIC_FILES`, such as ``"emps/DATA_EMPS.mat"``.

    Raises:
        DataError: if there is no such file, its checksum differs, or neither the folder nor the network has it.
    """
    address = url(name)
    sha256 = PUBLIC_FILES[name].sha256
    folder = os.environ.get(DATA_VARIABLE)
    if folder and (Path(folder) / name).is_file():
        return _checked(Path(folder) / name, sha256)
    try:
        return Path(
            pooch.retrieve(
                address,
                known_hash=f"sha256:{sha256}",
                fname=name.replace("/", "-"),
                path=pooch.os_cache("torch-activegp"),
                progressbar=False,
            )
        )
    except (OSError, ValueError) as error:
        found = f"not in {DATA_VARIABLE}={folder}" if folder else f"{DATA_VARIABLE} is not set"
        raise DataError(
            f"{name}: {found}, and the download failed: {error}. Connect to the network, or save {address} as `{name}` "
            f"in a folder and set {DATA_VARIABLE} to it."
        ) from error


def _checked(path: Path, sha256: str) -> Path:
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found != sha256:
        raise DataError(
            f"{path}: sha256 {sha256} wanted, found {found}. The file is damaged or altered: fetch it again."
        )
    return path
