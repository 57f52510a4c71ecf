"""How the site is built: `python -m sphinx -W docs build/site`.
Everything that it shows is in the built folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

from sepv._version import __version__

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "sepv"
author = "the sepv authors"
copyright = "2026, the sepv authors"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "gallery", "public_names"]
exclude_patterns = ["_ext", "_generated/*.txt"]
myst_enable_extensions = ["dollarmath"]
# A heading of any level can be linked to, as on the pages of a code host.
myst_heading_anchors = 4
# No fallback and no fetched script: formulas are MathML, which every browser of today shows.
html_math_renderer = "mathml"

# Signatures have types, which are links where sepv documents them; docstrings add shapes.
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80
autodoc_type_aliases = {"Array": "sepv.problem.Array", "ArrayLike": "numpy.typing.ArrayLike"}
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_param = False  # shapes such as (d, M) are no types that can be linked to
# Attributes of one name in two classes are both documented; a schematic … is no JSON.
suppress_warnings = ["ref.python", "misc.highlighting_failure"]

html_theme = "furo"
html_title = "sepv"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"source_edit_link": "", "source_view_link": ""}
