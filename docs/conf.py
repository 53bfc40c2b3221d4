"""The site: pages of this folder, tables from beside it, and the docstrings of the package.

pip install -c constraints.txt ".[docs]" && sphinx-build -W docs build/docs

Needs no network, and the pages that are built ask for none: fonts, search and styles are files
beside them.
"""

import dataclasses
import inspect
import json
import re
from pathlib import Path

from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import perfcap

project = "perfcap"
release = version = perfcap.__version__
copyright = "the perfcap contributors, Apache-2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

html_theme = "furo"
html_title = "perfcap"
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"top_of_page_buttons": []}  # they would lead to a repository's web page

myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True, "imported-members": True}
autodoc_type_aliases = {name: "numpy.ndarray" for name in ("Floats", "Integers", "Flags", "Mask")}
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_ivar = True

# links that are right where the files lie, and the pages that show these files
_SHOWN = (
    (r"(?:\.\./)?experiments/README\.md", "numbers.md"),
    (r"PUBLISHED\.md", "published.md"),
    (r"\.\./models/[\w/]+\.md", "models.md"),
    (r"docs/([\w/.-]+)", r"\1"),
)
_CODE = re.compile(r"(``.+?``|`[^`]+`_?)")
_MARKUP = re.compile(r"(?<!\\)([*|]|(?<=\w)_(?=\W|$))")
_RETURNED = re.compile(r"^( {4})(\w+): ")
_FIELD = re.compile(r"^ {4}(\w+): .*?  # (.+)$", re.MULTILINE)


def escape_shapes(lines: list[str]) -> None:
    """Let ``(*batch, F)``, ``|x|`` and ``k_`` read as they are written, in place."""
    code = False
    for index, line in enumerate(lines):
        if line.strip():
            deeper = line.startswith("    ") and index > 0 and lines[index - 2].endswith("::")
            code = line.lstrip().startswith(">>>") or deeper or (code and line.startswith(" "))
        if not code:
            parts = _CODE.split(line)
            parts[::2] = [_MARKUP.sub(r"\\\1", part) for part in parts[::2]]
            parts[2::2] = [re.sub(r"^(?=[\w^\[(])", r"\\ ", part) for part in parts[2::2]]
            lines[index] = "".join(parts)


def list_returns(lines: list[str]) -> None:
    """Make a list of several values that are returned, in place."""
    start = lines.index("Returns:") + 1 if "Returns:" in lines else len(lines)
    stop = next((i for i in range(start, len(lines)) if lines[i][:1].strip()), len(lines))
    names = [i for i in range(start, stop) if _RETURNED.match(lines[i])]
    if len(names) > 1 and names[0] == start:
        for i in range(start, stop):
            lines[i] = _RETURNED.sub(r"\1- **\2**, ", lines[i]) if i in names else "  " + lines[i]


def describe_fields(documented: type, lines: list[str]) -> list[str]:
    """Fields of a dataclass as what it is made of; settings have a comment each instead."""
    if "Attributes:" in lines:
        return ["Args:" if line == "Attributes:" else line for line in lines]
    notes = _FIELD.findall(inspect.getsource(documented))
    if not notes or "Args:" in lines:
        return lines
    return [*lines, "", "Args:", *(f"    {name}: {note}" for name, note in notes), ""]


def read_docstring(
    app: Sphinx, what: str, name: str, documented: object, options: object, lines: list[str]
) -> None:
    """Prepare a docstring for napoleon, in place."""
    if dataclasses.is_dataclass(documented) and what == "class":
        lines[:] = describe_fields(documented, lines)
    escape_shapes(lines)
    list_returns(lines)


def public_name(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.TextElement
) -> nodes.reference | None:
    """Link ``perfcap.folder.file.Name`` to where it is documented, ``perfcap.folder.Name``."""
    found = re.fullmatch(r"(perfcap\.\w+)\.\w+\.(\w+)", node.get("reftarget", ""))
    if not found or node.get("refdomain") != "py":
        return None
    domain, target = env.domains["py"], f"{found[1]}.{found[2]}"
    return domain.resolve_xref(
        env, node["refdoc"], app.builder, node["reftype"], target, node, content
    )


def relink(content: list[str]) -> None:
    """Lead links into the repository to the pages of the site that show these files, in place."""
    for link, page in _SHOWN:
        content[0] = re.sub(rf"\]\({link}(?=[)#])", rf"]({page}", content[0])


def read_include(app: Sphinx, path: Path, parent: str, content: list[str]) -> None:
    """Prepare a table from beside this folder, in place."""
    relink(content)


def read_page(app: Sphinx, name: str, content: list[str]) -> None:
    """Prepare a page, in place."""
    relink(content)


class NotebookParser(MystParser):
    """A notebook without outputs, as a page: its text, and its code in fences."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse the cells as one text."""
        cells = json.loads(inputstring)["cells"]
        texts = [
            f"```python\n{''.join(cell['source'])}\n```"
            if cell["cell_type"] == "code"
            else "".join(cell["source"])
            for cell in cells
        ]
        super().parse("\n\n".join(texts), document)


def setup(app: Sphinx) -> None:
    """Register the above."""
    # before napoleon, which knows what its own markup means
    app.connect("autodoc-process-docstring", read_docstring, priority=400)
    app.connect("missing-reference", public_name)
    app.connect("include-read", read_include)
    app.connect("source-read", read_page)
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
