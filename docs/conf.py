"""The site's configuration. `make docs` builds it, warnings being errors."""

import hashlib
import importlib
import inspect
import os
import re
from pathlib import Path

from jupyter_cache import get_cache
from sphinx.util.inspect import TypeAliasForwardRef

import floquid

# Pages that measure read the records of the tests.
ROOT = Path(__file__).parents[1]
os.environ["FLOQUID_ROOT"] = str(ROOT)


def source() -> str:
    """A hash of all but their own cells that pages are computed from."""
    found = hashlib.sha256((ROOT / "requirements.txt").read_bytes())
    for path in sorted(path for folder in ("src", "examples", "benchmarks") for path in (ROOT / folder).rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            found.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


project = "floquid"
author = "floquid developers"
copyright = "2026, floquid developers"
version = release = floquid.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # formulas without a network
    "numpydoc",
    "myst_nb",
    "sphinxcontrib.bibtex",
]
exclude_patterns = ["_build"]
bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "plain"

html_theme = "furo"
html_title = "floquid"

myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 3
# A page that computes is run by the build, in an empty folder, and a cell that fails, fails the build. What its cells
# gave is kept until they or the source change.
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "docs" / "_build" / "executed" / source())
nb_execution_in_temp = True
# The processes that read pages would otherwise all make its tables at once.
Path(nb_execution_cache_path).mkdir(parents=True, exist_ok=True)
get_cache(nb_execution_cache_path).list_cache_records()
# What a cell prints stands in one box, whenever the kernel flushes.
nb_merge_streams = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300

# The docstrings say shape, unit and meaning; the signature says the type.
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_use_type_comments = False
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}
# `ArrayLike | None` is printed from the alias' repr.
TypeAliasForwardRef.__repr__ = lambda self: self.name
python_use_unqualified_type_names = True
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

# Every reference to our own public names must resolve; other projects' sites are not asked for theirs, and what an
# algorithm passes from one of its steps to the next may be a private type.
nitpick_ignore_regex = [("py:.*", r"(?!floquid\b).*"), ("py:.*", r"floquid\.(\w+\.)*_\w+\.\w+")]
nitpick_ignore = [
    *(("py:class", f"floquid.search.{name}") for name in ("Structure", "P")),  # type variables have no page
]


def public_home() -> None:
    """Give each public object the package that exports it as its module, so that references find its page.

    A record's type is written in `floquid.core._record` and documented, as it is imported, in `floquid.core`.
    """
    root = Path(floquid.__file__).parent
    pages = (Path(__file__).parent / "reference").glob("*.md")
    for page in sorted(pages):
        for name in re.findall(r"\.\. automodule:: (\S+)", page.read_text(encoding="utf-8")):
            package = importlib.import_module(name)
            for public in getattr(package, "__all__", ()):
                thing = getattr(package, public)
                if not (inspect.isclass(thing) or inspect.isfunction(thing)):
                    continue
                source = inspect.getsourcefile(thing)
                if source is not None and root in Path(source).parents:
                    thing.__module__ = name


def escape_bars(_app, _what, _name, _thing, _options, lines: list[str]) -> None:
    """Let a docstring say |λ|: reST would take the bars for a substitution, which our docstrings never use."""
    directive = None
    for number, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if directive is not None and line.strip() and indent <= directive:
            directive = None
        if line.lstrip().startswith(".. "):
            directive = indent
        if directive is None:
            pieces = re.split(r"(:\w+:`[^`]*`|``.*?``|`[^`]*`)", line)
            pieces[::2] = [re.sub(r"(?<!\\)\|", r"\|", piece) for piece in pieces[::2]]
            lines[number] = "".join(pieces)


def spread(_app, _env, names: list[str]) -> None:
    """Mix pages that compute with those that do not: they are read in parallel, some at once."""
    quiet = [name for name in names if name.startswith(("decisions/", "reference/"))]
    busy = [name for name in names if name not in quiet]
    place = {name: (number + 0.5) / len(group) for group in (quiet, busy) for number, name in enumerate(group)}
    names.sort(key=place.__getitem__)


def setup(app) -> None:
    """Sphinx calls this."""
    public_home()
    app.connect("env-before-read-docs", spread)
    app.connect("autodoc-process-docstring", escape_bars, priority=100)
    # It adds a file to the site and reads no page; unless it says so, pages are run one after the other.
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True
