"""Robots and objects of the packaged scenarios, as model files."""

from pathlib import Path

from pydrake.multibody.parsing import PackageMap, Parser

PACKAGE = "drake_cafim_models"
"""Name under which the model files are found: package://drake_cafim_models/arm7.urdf."""


def add_to_package_map(parser: Parser) -> None:
    """Let `parser` resolve package://drake_cafim_models/... (again is harmless)."""
    packages: PackageMap = parser.package_map()
    if not packages.Contains(PACKAGE):
        packages.AddPackageXml(Path(__file__).parent / "package.xml")
