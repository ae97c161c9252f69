"""Settings of the documentation site: `python -m sphinx -W --keep-going -c docs . build/site`.

The source folder is the repository, so that links from a page to what lies outside `docs/` are links of the site too.
Nothing is fetched, neither by the build nor by a reader's browser.
"""

import sys
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
sys.path[:0] = [str(REPOSITORY), str(Path(__file__).parent)]  # packages that are documented; extensions

project = "SimpleQuad"
root_doc = "docs/index"
include_patterns = [
    "*.md",
    "benchmarks/*.md",
    "docs/**",
    "examples/*.md",
    "models/**.md",
    "policies/**.md",
    "research/*.md",
]
exclude_patterns = [".*", "**/.*", "build", "dist", "results", "runs", "tests", "docs/extensions", "docs/templates"]

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "extensions.contents",
    "extensions.docstrings",
    "extensions.examples",
    "extensions.mathml",
    "extensions.mermaid",
]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 1800
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
default_role = "literal"  # what stands between single back quotes in a docstring
maximum_signature_line_length = 88

html_theme = "furo"
html_math_renderer = "mathml"
html_title = "SimpleQuad"
html_copy_source = False
html_show_copyright = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_additional_pages = {"index": "to-the-first-page.html"}
templates_path = ["templates"]
