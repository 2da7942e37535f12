"""Visual meshes of an MJCF that the replay can show."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from drake_cafim.description.description import SHOWN, VisualMesh
from drake_cafim.description.mjcf_defaults import Defaults
from drake_cafim.description.mjcf_frames import Compiler
from drake_cafim.description.xml_document import numbers


@dataclass(frozen=True)
class Meshes:
    """Mesh files with their scales, and colours of materials, each by name."""

    files: Mapping[str, tuple[Path, tuple[float, ...]]]
    colors: Mapping[str, tuple[float, ...]]
    compiler: Compiler

    @classmethod
    def of(cls, root: Element, defaults: Defaults, compiler: Compiler, path: Path) -> "Meshes":
        """The meshes and colours among the assets of the file at `path`."""
        folder = path.parent / compiler.says("meshdir", compiler.says("assetdir", ""))
        files, colors = {}, {}
        for asset in [element for section in root.findall("asset") for element in section]:
            if asset.tag == "mesh" and asset.get("file"):
                defaults.write_out(asset, None)
                file = Path(os.path.realpath(folder / asset.get("file", "").replace("\\", "/")))
                scale = tuple(numbers(asset, "scale", "1 1 1"))
                if os.path.isfile(file) and file.suffix.lower() in SHOWN:
                    files[asset.get("name") or file.stem] = file, scale
            elif asset.tag == "material" and asset.get("rgba"):
                colors[asset.get("name", "")] = tuple(numbers(asset, "rgba"))
        return cls(files, colors, compiler)

    def visual_meshes(self, body: str, geoms: list[Element]) -> list[VisualMesh]:
        """The visual meshes among a body's `geoms`: those without contact, or all where there are none without.

        MJCF does not mark visual geometry; by convention it has contype and conaffinity 0.
        """
        silent = [geom for geom in geoms if geom.get("contype") == "0" and geom.get("conaffinity") == "0"]
        found = []
        for geom in silent or geoms:
            if geom.get("mesh") in self.files:
                file, scale = self.files[geom.get("mesh", "")]
                color = tuple(numbers(geom, "rgba")) or self.colors.get(
                    geom.get("material", ""), (0.6, 0.62, 0.65, 1.0)
                )
                found.append(VisualMesh(body, file, *self.compiler.pose(geom), scale, color))
        return found
