"""One self-contained page from a diagnosis and its evidence."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from torch_activegp.errors import ConfigurationError, DataError
from torch_activegp.files import written_whole
from torch_activegp.report.correction import correction
from torch_activegp.report.law import law
from torch_activegp.report.parameters import parameters
from torch_activegp.report.place import place
from torch_activegp.report.rivals import rivals
from torch_activegp.report.sources import sources
from torch_activegp.report.stability import stability
from torch_activegp.report.traces import traces
from torch_activegp.report.unknowns import unknowns
from torch_activegp.report.verdict import banner

_SECTIONS = (place, rivals, law, traces, parameters, stability, correction, unknowns, sources)
_STYLES = ("page.css", "banner.css", "tables.css", "charts.css", "narrow.css", "print.css")
_SCRIPT = "page.js"


def write_report(diagnosis: Mapping[str, Any], evidence: Mapping[str, Any], path: str | Path) -> Path:
    """Write the report as one HTML file that needs no network; the file is whole or absent.

    Args:
        diagnosis: the value that ``diagnosis.json`` holds; of its keys only ``verdict`` is required.
        evidence: plain lists to draw: ``map_time``, ``map_region``, ``laws``, ``traces``; each may be missing.
        path: where to write; its folder is made, and an earlier file is replaced.

    Returns:
        The path.

    Raises:
        DataError: the verdict is none of the four, or an entry lacks what it must hold.
        ConfigurationError: the file cannot be written.
    """
    path = Path(path)
    text = render_report(diagnosis, evidence)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as file:
            file.write(text.encode())
    except OSError as error:
        raise ConfigurationError(
            f"Cannot write the report {path}: {error.strerror or error}. Choose another place, or mend its permissions "
            "or the disk."
        ) from error
    return path


def render_report(diagnosis: Mapping[str, Any], evidence: Mapping[str, Any]) -> str:
    """The report as text: the same bytes for the same diagnosis and evidence.

    Args:
        diagnosis: see :func:`write_report`.
        evidence: see :func:`write_report`.

    Raises:
        DataError: the verdict is none of the four, or an entry lacks what it must hold.
    """
    top = banner(diagnosis)
    try:
        sections = [section for build in _SECTIONS if (section := build(diagnosis, evidence)) is not None]
    except KeyError as error:
        raise DataError(
            f"The diagnosis or its evidence has an entry without {error}. Write the report from what diagnose() gave."
        ) from error
    templates = Environment(
        loader=PackageLoader("torch_activegp.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["code"] = _with_code
    script = _asset(templates, _SCRIPT)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return templates.get_template("page.html").render(
        top=top,
        sections=sections,
        style=Markup("\n".join(_asset(templates, name) for name in _STYLES)),
        script=Markup(script),
        script_hash=digest,
        version=version("torch-activegp"),
    )


def _with_code(text: str) -> Markup:
    """A sentence with what stands between backticks as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _asset(templates: Environment, name: str) -> str:
    """A style sheet or script of ours, as it is."""
    loader = templates.loader
    return loader.get_source(templates, name)[0] if loader else ""
