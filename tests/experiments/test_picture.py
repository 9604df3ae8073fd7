from __future__ import annotations

from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from torch_activegp.experiments.picture import LOOK, save_picture


def test_a_picture_is_a_png_and_an_svg_and_always_the_same_bytes(tmp_path: Path) -> None:
    contents = []
    for name in ("first", "second"):
        with matplotlib.rc_context(LOOK):
            figure = Figure(figsize=(2, 2))
            figure.subplots().plot([0, 1], [1, 0], label="line")
            files = save_picture(figure, tmp_path / name)
        assert [file.suffix for file in files] == [".png", ".svg"]
        contents.append([file.read_bytes() for file in files])
    assert contents[0] == contents[1]
    assert contents[0][0].startswith(b"\x89PNG")
    assert {file.name for file in tmp_path.iterdir()} == {"first.png", "first.svg", "second.png", "second.svg"}
