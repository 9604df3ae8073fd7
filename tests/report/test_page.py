from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from torch_activegp.errors import ConfigurationError, DataError
from torch_activegp.report import render_report, write_report

VERDICTS = ("none", "named", "tie", "unknown")
VOID = {"meta", "path", "rect", "br"}
ALL = ["place", "rivals", "law", "traces", "parameters", "stability", "correction", "unknowns", "sources"]
EMPTY: dict[str, Any] = {"schema_version": 1, "verdict": "none", "mismatch": {}, "effects": []}


class Page(HTMLParser):
    """Elements in order, text in order, and a check that every tag is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[tuple[str, str]] = []
        self.open: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.words.append((self.open[-1], data.strip()))

    def ids(self, tag: str) -> list[str | None]:
        return [attributes.get("id") for name, attributes in self.elements if name == tag]

    def visible(self) -> list[str]:
        return [text for tag, text in self.words if tag not in ("title", "style", "script")]


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_verdict_is_the_first_sentence_that_one_reads(fakes: Any, verdict: str) -> None:
    diagnosis, evidence = fakes[verdict]()
    page = Page(render_report(diagnosis | {"sentence": "The elbow sticks."}, evidence))
    assert page.visible()[0] == "The elbow sticks."
    assert ("h1", "The elbow sticks.") in page.words
    assert ("body", {"class": verdict}) in page.elements


@pytest.mark.parametrize("verdict", VERDICTS)
def test_headings_and_anchors_are_whole(fakes: Any, verdict: str) -> None:
    page = Page(render_report(*fakes[verdict]()))
    tags = [tag for tag, _ in page.elements]
    assert tags.count("h1") == 1
    assert tags.count("h2") == tags.count("section") >= 5
    links = [attributes["href"] for tag, attributes in page.elements if tag == "a"]
    assert links == [f"#{name}" for name in page.ids("section")]
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(set(ids)) == len(ids)
    levels = [int(tag[1]) for tag in tags if re.fullmatch("h[1-4]", tag)]
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_a_section_is_there_with_its_data_and_absent_without(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    assert Page(render_report(diagnosis, evidence)).ids("section") == ALL
    assert Page(render_report(EMPTY, {})).ids("section") == ["unknowns"]
    without = Page(render_report(diagnosis | {"rivals": [], "stability": None}, evidence | {"laws": []}))
    assert without.ids("section") == [name for name in ALL if name not in ("rivals", "law", "stability")]


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_contract_alone_is_enough(fakes: Any, verdict: str) -> None:
    diagnosis, _ = fakes[verdict]()
    contract = ("schema_version", "verdict", "mismatch", "location", "effects", "unexplained", "fit", "next_experiment")
    Page(render_report({key: diagnosis[key] for key in contract}, {}))
    Page(render_report({"verdict": verdict}, {}))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_nothing_is_loaded_and_the_file_mails_well(fakes: Any, verdict: str) -> None:
    text = render_report(*fakes[verdict]())
    assert len(text.encode()) < 500_000
    assert "http:" not in text and "https:" not in text and "//" not in re.sub(r"\n\s*// .*", "", text)
    assert "@import" not in text and "url(" not in text and "@font-face" not in text
    page = Page(text)
    assert not any({"src", "srcset", "xlink:href"} & attributes.keys() for _, attributes in page.elements)
    assert not any(tag in ("link", "img", "iframe", "object", "base") for tag, _ in page.elements)


def test_only_our_script_may_run(fakes: Any) -> None:
    text = render_report(*fakes["named"]())
    (script,) = re.findall(r"<script>(.*?)</script>", text, flags=re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'" in text


def _poisoned(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: value[key] if key in ("verdict", "role") else _poisoned(value[key]) for key in value}
    if isinstance(value, list):
        return [_poisoned(item) for item in value]
    return f"{value}<script>alert(1)</script>\"'&" if isinstance(value, str) else value


@pytest.mark.parametrize("verdict", VERDICTS)
def test_text_of_the_user_is_escaped(fakes: Any, verdict: str) -> None:
    text = render_report(*map(_poisoned, fakes[verdict]()))
    assert text.count("<script>") == 1
    assert "<script>alert" not in text and "&lt;script&gt;" in text
    page = Page(text)
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_missing_and_endless_numbers_are_shown_as_such(fakes: Any, verdict: str) -> None:
    def broken(value: Any, by: float | None) -> Any:
        if isinstance(value, dict):
            kept = ("time", "edges", "rows")
            return {key: value[key] if key in kept else broken(value[key], by) for key in value}
        if isinstance(value, list):
            return [broken(item, by) for item in value]
        return by if isinstance(value, float) else value

    diagnosis, evidence = fakes[verdict]()
    for by in (None, float("nan"), float("inf"), 0.0):
        text = render_report(broken(diagnosis, by), broken(evidence, by))
        assert not re.search(r"\b(nan|inf|None)\b", text.partition("<body")[2].partition("<script>")[0])


def test_values_read_back_from_json_give_the_same_page(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    again = json.loads(json.dumps([diagnosis, evidence]))
    assert render_report(*again) == render_report(diagnosis, evidence)


def test_the_light_the_dark_the_narrow_and_the_printed_page_have_styles(fakes: Any) -> None:
    text = render_report(*fakes["named"]())
    for rule in (
        "@media screen and (prefers-color-scheme: dark)",
        "@media screen and (max-width: 640px)",
        "@media print",
    ):
        assert rule in text


def test_the_file_is_written_whole(fakes: Any, tmp_path: Path) -> None:
    path = write_report(*fakes["named"](), tmp_path / "new" / "report.html")
    assert path == tmp_path / "new" / "report.html"
    assert path.read_text(encoding="utf-8") == render_report(*fakes["named"]())
    assert list(path.parent.iterdir()) == [path]


def test_a_failure_leaves_the_earlier_file(fakes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("earlier")

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ConfigurationError, match=r"report.html: No space left on device. Choose another place"):
        write_report(*fakes["none"](), path)
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]
    assert path.read_text() == "earlier"


def test_a_folder_that_is_a_file_is_said(fakes: Any, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="Cannot write the report"):
        write_report(*fakes["none"](), tmp_path / "file" / "report.html")


def test_a_wrong_verdict_and_an_incomplete_entry_are_said() -> None:
    with pytest.raises(DataError, match="wanted one of none, named, tie, unknown, found 'maybe'"):
        render_report({"verdict": "maybe"}, {})
    with pytest.raises(DataError, match="an entry without 'target'"):
        render_report({"verdict": "named", "location": [{"share": 0.5}]}, {})


def test_what_a_reader_asks_stands_where_he_looks(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    payload = {
        "name": "payload_mass",
        "target": "body:forearm",
        "too_much": True,
        "parameters": {"distance": {"value": 0.05, "unit": "m", "ci95": [0.04, 0.06]}},
    }
    words = Page(render_report(diagnosis | {"effects": [payload, fakes["tie"]()[0]["effects"][0]]}, evidence)).words
    texts = [text.replace("\u00a0", " ") for _, text in words]
    assert "not used in the fit, a gap, or the run is over" in texts
    assert "the simulator has too much of it" in texts
    assert any(text.startswith("50 mm from the body's nominal centre of mass, towards") for text in texts)
    assert "From zero or one" in texts
    assert "From zero" in texts  # of what was fitted along


def test_paper_breaks_between_figures_and_rows_and_inside_long_sections_only(fakes: Any) -> None:
    printed = render_report(*fakes["named"]()).partition("@media print {")[2].partition("</style>")[0]
    rules = re.findall(r"([^{}]+)\{([^{}]*break-inside: avoid[^{}]*)\}", printed)
    whole = {selector.strip() for selectors, _ in rules for selector in selectors.split(",")}
    assert {"tr", "figure", ".strip"} <= whole
    assert not {"section", ".pair", ".code", "table", ".tiles"} & whole


def test_names_between_backticks_are_code_and_nothing_else_is_let_through(fakes: Any) -> None:
    diagnosis, evidence = fakes["unknown"]()
    text = render_report(diagnosis | {"sentence": "They differ. Check `ctrl.<a>` & mend it."}, evidence)
    assert '<p class="more">Check <code>ctrl.&lt;a&gt;</code> &amp; mend it.</p>' in text
