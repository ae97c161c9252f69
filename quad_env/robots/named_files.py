"""The files that an MJCF names: meshes, height fields, textures, and further MJCF files, which name some themselves."""

import re
from pathlib import Path

from quad_env.files.reading import check_file, read_bytes

_FILE = re.compile(r"""\bfile\w*\s*=\s*["']([^"'\0]+)["']""")
_FOLDER = re.compile(r"""\b(?:mesh|texture|asset)dir\s*=\s*["']([^"'\0]*)["']""")
_MODELS = ".xml", ".urdf"


def check_named(path: Path) -> None:
    """Raise OSError if the MJCF, or a file that it names, is no regular file or too large; what is missing is MuJoCo's
    to say."""
    todo, texts = [path], dict[Path, str]()
    while todo:
        file = todo.pop()
        text = texts[file] = read_bytes(file).decode(errors="replace")
        folders = {"", *(folder for each in texts.values() for folder in _FOLDER.findall(each))}
        for place in {path.parent / folder / name for folder in folders for name in _FILE.findall(text)}:
            if place.exists():
                check_file(place)
                if place.suffix.lower() in _MODELS and place not in texts:
                    todo.append(place)
