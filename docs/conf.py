"""Settings of the documentation site: `sphinx-build -W docs build/site`."""

import sys
from pathlib import Path

import whichroad

sys.path.insert(0, str(Path(__file__).parent / "sphinx_ext"))

project = "whichroad"
author = "The whichroad authors"
copyright = f"2026, {author}"
version = release = whichroad.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "generated_reference",
    "repository_files",
]
exclude_patterns = ["sphinx_ext", "**.ipynb_checkpoints"]
default_role = "code"  # docstrings quote names by single backticks, as Markdown does

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4  # links to headings work here as on a code host
nb_execution_mode = "off"  # the tests execute them; -D nb_execution_mode=force adds pictures
nb_execution_raise_on_error = True
nb_execution_timeout = 300

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "pydata_sphinx_theme"
html_title = "whichroad"
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "header_links_before_dropdown": 6,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
html_sidebars = {"index": []}
html_copy_source = False
