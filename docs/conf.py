"""The site: `make docs`. Builds without the network; the gallery is executed."""

import os
import warnings
import zlib
from pathlib import Path

import matplotlib as mpl

from greybox_id.base.version import __version__

HERE = Path(__file__).parent
mpl.use("Agg")
warnings.filterwarnings("ignore", message=".*non-interactive, and thus cannot be shown.*")

project, author, release = "greybox-id", "greybox-id developers", __version__
copyright = "2026, greybox-id developers"
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx_gallery.gen_gallery",
]
templates_path = ["_templates"]
exclude_patterns = ["made", "_templates", "gallery/**/*.ipynb", "gallery/**/*.md5"]
myst_heading_anchors = 3
suppress_warnings = ["config.cache", "misc.highlighting_failure"]  # consoles and formulas in fences are no language

html_theme = "pydata_sphinx_theme"
html_title = f"greybox-id {release}"
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "show_prev_next": False,
    "header_links_before_dropdown": 3,
}
html_sidebars = {
    page: [] for page in ("*", "decisions/*")
}  # pages without pages below them: no empty column beside them
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["wide.css"]

autosummary_generate = True
autodoc_typehints = "none"
numpydoc_show_class_members = False

sphinx_gallery_conf = {
    "examples_dirs": [str(HERE.parent / "examples" / "gallery")],
    "gallery_dirs": ["gallery"],
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "abort_on_example_error": True,
    "min_reported_time": 1e9,
    "ignore_repr_types": r"matplotlib[.]|numpy[.]ndarray",
}

OTHERS = {
    "numpy": ("https://numpy.org/doc/stable/", {
        "numpy.ndarray py:class 1 reference/generated/numpy.ndarray.html -",
        "numpy.random.Generator py:class 1 reference/random/generator.html -",
    }),
    "pandas": ("https://pandas.pydata.org/docs/", {
        "pandas.DataFrame py:class 1 reference/api/pandas.DataFrame.html -",
        "pandas.Series py:class 1 reference/api/pandas.Series.html -",
    }),
    "control": ("https://python-control.readthedocs.io/en/latest/", {
        "control.StateSpace py:class 1 generated/control.StateSpace.html -",
    }),
    "casadi": ("https://web.casadi.org/", {
        "casadi.Function py:class 1 docs/ -",
        "casadi.SX py:class 1 docs/ -",
    }),
    "matplotlib": ("https://matplotlib.org/stable/", {
        "matplotlib.axes.Axes py:class 1 api/_as_gen/matplotlib.axes.Axes.html -",
        "matplotlib.figure.Figure py:class 1 api/_as_gen/matplotlib.figure.Figure.html -",
    }),
}  # fmt: skip
"""What pages refer to elsewhere; CasADi has no inventory. GREYBOX_DOCS_ONLINE=1 fetches those of the others."""


def inventory(name: str, entries: set[str]) -> str:
    """A file that says where names of another project are documented."""
    file = HERE / "made" / f"{name}.inv"
    file.parent.mkdir(exist_ok=True)
    head = f"# Sphinx inventory version 2\n# Project: {name}\n# Version: \n# The remainder is compressed using zlib.\n"
    file.write_bytes(head.encode() + zlib.compress("".join(f"{entry}\n" for entry in sorted(entries)).encode()))
    return str(file)


ONLINE = os.environ.get("GREYBOX_DOCS_ONLINE") == "1"
intersphinx_mapping = {
    name: (url, None if ONLINE and name != "casadi" else inventory(name, entries))
    for name, (url, entries) in OTHERS.items()
}
