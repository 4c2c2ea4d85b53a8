"""What package.xml and setup.py say of the package."""

import ast
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROOT = Path(__file__).parents[3]
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()
# The keyword arguments of `setup`, those that are literals.
SETUP = {
    node.arg: node.value
    for node in ast.walk(ast.parse((ROOT / "setup.py").read_text()))
    if isinstance(node, ast.keyword)
}
REQUIREMENTS = [
    re.match(r"[\w-]+", text)[0] for text in ast.literal_eval(SETUP["install_requires"])
]


def declared(*tags):
    """Return the dependencies in package.xml of these kinds."""
    return {element.text for element in MANIFEST if element.tag in tags}
