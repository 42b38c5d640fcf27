"""Sphinx configuration: `sphinx-build -W docs docs/_build` with the extra `docs` installed.

`LPVID_DOCS` chooses how much is computed at build: `full` (every example runs), `quick` (the examples of seconds run;
the others are shown with their source only), `none` (no example runs; pictures are made all the same).
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE.parent))
os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
os.environ.setdefault("MPLBACKEND", "agg")
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from building.api import write_api  # noqa: E402
from building.commands import write_commands  # noqa: E402
from building.docstrings import escape_marks  # noqa: E402
from building.gallery import prepare_examples, settings  # noqa: E402

import lpvid  # noqa: E402

AMOUNT = os.environ.get("LPVID_DOCS", "full")
if AMOUNT not in ("full", "quick", "none"):
    raise SystemExit(f"LPVID_DOCS: got {AMOUNT!r}; it is full, quick or none")

project = "lpvid and quartercar"
author = "the lpvid founders"
copyright = "the lpvid founders, BSD-3-Clause"
release = version = lpvid.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_parser",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "_prepared", "tutorial/*.rst", "tutorial/*.py", "**/*.ipynb", "generated/**/*.zip"]
templates_path = ["_templates"]
nitpicky = False
default_role = "code"
toc_object_entries = False

myst_enable_extensions = ["deflist", "colon_fence", "substitution"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

autosummary_generate = True
autosummary_ignore_module_all = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
numpydoc_validation_checks: set[str] = set()

html_theme = "pydata_sphinx_theme"
html_title = "lpvid and quartercar"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = html_copy_source = False
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "collapse_navigation": True,
    "header_links_before_dropdown": 6,
    "navbar_align": "left",
    "secondary_sidebar_items": {"**": ["page-toc"], "index": []},
    "footer_start": ["copyright"],
    "footer_end": ["theme-version"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_sidebars = {"index": [], "generated/api/*": []}
copybutton_exclude = ".linenos, .gp, .go"
suppress_warnings = ["config.cache"]

sphinx_gallery_conf = settings(HERE, AMOUNT)

prepare_examples(HERE, AMOUNT)
write_api(HERE / "generated" / "api")
write_commands(HERE / "generated" / "commands")


def setup(app) -> None:
    """Pictures first, then docstrings without marks that reStructuredText would read as its own."""
    from pictures import draw_missing

    draw_missing(HERE / "generated" / "pictures")
    app.connect("autodoc-process-docstring", escape_marks, priority=100)  # numpydoc is at 500
