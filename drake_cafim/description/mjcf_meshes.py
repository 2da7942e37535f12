"""The meshes of an MJCF that can be shown."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from drake_cafim.description.description import SHOWN, Shown
from drake_cafim.description.mjcf_defaults import Defaults
from drake_cafim.description.mjcf_frames import Compiler
from drake_cafim.description.xml_document import numbers


@dataclass(frozen=True)
class Meshes:
    """Files, with their scales, and colours by name."""

    files: Mapping[str, tuple[Path, tuple[float, ...]]]
    colors: Mapping[str, tuple[float, ...]]
    compiler: Compiler

    @classmethod
    def of(cls, root: Element, defaults: Defaults, compiler: Compiler, path: Path) -> "Meshes":
        """Of the assets of the file at `path`."""
        folder = path.parent / compiler.says("meshdir", compiler.says("assetdir", ""))
        files, colors = {}, {}
        for asset in [one for section in root.findall("asset") for one in section]:
            if asset.tag == "mesh" and asset.get("file"):
                defaults.write_out(asset, None)
                file = (folder / asset.get("file", "")).resolve()
                scale = tuple(numbers(asset, "scale", "1 1 1"))
                if file.is_file() and file.suffix.lower() in SHOWN:
                    files[asset.get("name") or file.stem] = file, scale
            elif asset.tag == "material" and asset.get("rgba"):
                colors[asset.get("name", "")] = tuple(numbers(asset, "rgba"))
        return cls(files, colors, compiler)

    def shown(self, body: str, geoms: list[Element]) -> list[Shown]:
        """What of a body's meshes is drawn: those that touch nothing, or all where there are no such."""
        silent = [one for one in geoms if one.get("contype") == "0" and one.get("conaffinity") == "0"]
        found = []
        for geom in silent or geoms:
            if geom.get("mesh") in self.files:
                file, scale = self.files[geom.get("mesh", "")]
                color = tuple(numbers(geom, "rgba")) or self.colors.get(
                    geom.get("material", ""), (0.6, 0.62, 0.65, 1.0)
                )
                found.append(Shown(body, file, *self.compiler.pose(geom), scale, color))
        return found
