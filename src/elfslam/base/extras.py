"""Which extra of the package brings a module, and how one is installed."""

import re
from importlib import metadata

DISTRIBUTIONS = {
    "PIL": "pillow",
    "anyio": "fastapi",
    "cryptography": "trustme",
    "faiss": "faiss-cpu",
    "h11": "uvicorn",
    "paho": "paho-mqtt",
    "pydantic": "fastapi",
    "resvg_py": "resvg-py",
    "sklearn": "scikit-learn",
    "starlette": "fastapi",
}
"""What an extra names to bring a module that is called otherwise."""
FOR_TESTS = "test"
TARGETS = {
    **dict.fromkeys(("serve", "images", "parquet"), "make serve"),
    **dict.fromkeys(
        ("learn", "studies", "acoustics", "speech", "scale", "buildings"), "make studies"
    ),
}
"""What installs an extra in a checkout, where the package alone is got from."""


def extra_with(module: str) -> str | None:
    """The first extra that brings a module such as torch.nn, as the installed package says."""
    top = module.partition(".")[0]
    if top == "elfslam":  # extras that name each other are of this name, too
        return None
    wanted = DISTRIBUTIONS.get(top, top)
    for line in metadata.requires("elfslam") or ():
        named = re.match(r"""([\w-]+).*extra == ["'](\w+)["']""", line)
        if named is not None and named[1] == wanted and named[2] != FOR_TESTS:
            return named[2]
    return None


def installing(extra: str) -> str:
    """What a user runs to get an extra."""
    command = TARGETS.get(extra, f".venv/bin/python -m pip install --editable '.[{extra}]'")
    return f"run {command} in the checkout"
