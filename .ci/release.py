"""``python .ci/release.py check|fill|links``: what a release lacks, and where addresses belong.

``check`` prints every reason why this checkout must not be published, one a line, and exits with 1
if there is any. ``fill`` copies the addresses of ``publish.toml`` to the files that show them.
``links`` lets README.md link to the files of this version in the repository, because a package
index shows it without these files. It is for the packages alone and is not committed.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACEHOLDER = "FILL IN"
SHOWN = {"repository": "repository-code", "documentation": "url", "doi": "doi"}
"""The keys of ``publish.toml`` that CITATION.cff shows, and their names there."""
ADDRESS = re.compile(r"https://\S+\.\S+")
LINK = re.compile(r"(!?)\[([^][]*)\]\((?!https?:|#)([^()\s]+)\)")
"""A link, or a picture, of another file of the repository."""
FORMS = {
    "repository": ADDRESS,
    "documentation": ADDRESS,
    "contact": re.compile(r"\S+@\S+\.\S+"),
    "doi": re.compile(r"10\.\d{4,9}/\S+"),
}


def main(arguments: list[str], root: Path = ROOT) -> int:
    """Check or fill; return the exit code."""
    changes = {"fill": fill, "links": links}
    if len(arguments) != 1 or arguments[0] not in ("check", *changes):
        print("usage: python .ci/release.py check|fill|links", file=sys.stderr)
        return 2
    problems = [*unfilled(root)]
    if change := changes.get(arguments[0]):
        if not problems:
            change(root)
    else:
        problems += unlike(root)
    for problem in problems:
        print(problem, file=sys.stderr)
    return int(bool(problems))


def unfilled(root: Path) -> Iterator[str]:
    """Yield what is wrong with the addresses in ``publish.toml``."""
    for key, form in FORMS.items():
        value = addresses(root).get(key, PLACEHOLDER)
        if value == PLACEHOLDER:
            yield f"publish.toml: {key}: it has to be filled in"
        elif not form.fullmatch(value):
            yield f"publish.toml: {key}: {value!r} does not look like one"


def unlike(root: Path) -> Iterator[str]:
    """Yield where the version or an address is not what it is elsewhere."""
    version = version_of(root)
    cited = (root / "CITATION.cff").read_text(encoding="utf-8")
    if f"\nversion: {version}\n" not in cited:
        yield f"CITATION.cff: its version is not {version}, that of desim_uav/__init__.py"
    changes = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    if not re.search(rf"^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$", changes, re.MULTILINE):
        yield f"CHANGELOG.md: there is no heading '## {version} (YYYY-MM-DD)' with the day"
    if not re.search(r"^date-released: \d{4}-\d\d-\d\d$", cited, re.MULTILINE):
        yield "CITATION.cff: there is no date-released"
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    known = addresses(root)
    for key, value in ((key, value) for key, value in known.items() if value != PLACEHOLDER):
        if key in SHOWN and f"{SHOWN[key]}: {value}" not in cited:
            yield f"CITATION.cff: {SHOWN[key]} is not that of publish.toml; run .ci/release.py fill"
        if key in ("repository", "documentation") and f'{key.title()} = "{value}"' not in project:
            yield f"pyproject.toml: {key} is not that of publish.toml; run .ci/release.py fill"


def fill(root: Path) -> None:
    """Write the addresses to CITATION.cff and pyproject.toml, in place of earlier ones."""
    known = addresses(root)
    names = "|".join(SHOWN.values())
    citation = root / "CITATION.cff"
    kept = re.sub(rf"^(?:{names}): .*\n", "", citation.read_text(encoding="utf-8"), flags=re.M)
    shown = "".join(f"{name}: {known[key]}\n" for key, name in SHOWN.items())
    citation.write_text(kept.replace("license:", shown + "license:", 1), encoding="utf-8")
    project = root / "pyproject.toml"
    text = project.read_text(encoding="utf-8")
    kept = re.sub(r"^\[project\.urls\]\n(?:\w+ = .*\n)+\n", "", text, flags=re.M)
    urls = "".join(f'{key.title()} = "{known[key]}"\n' for key in ("repository", "documentation"))
    section = f"[project.urls]\n{urls}\n"
    project.write_text(
        kept.replace("[project.scripts]", section + "[project.scripts]", 1), encoding="utf-8"
    )


def links(root: Path) -> None:
    """Let the links of README.md name the files of this version at the repository's address."""
    readme, at = root / "README.md", addresses(root)["repository"].rstrip("/")

    def absolute(link: re.Match[str]) -> str:
        picture, words, file = link.groups()
        kind = "raw" if picture else "blob"
        return f"{picture}[{words}]({at}/{kind}/v{version_of(root)}/{file})"

    readme.write_text(LINK.sub(absolute, readme.read_text(encoding="utf-8")), encoding="utf-8")


def addresses(root: Path) -> dict[str, str]:
    """Return the content of ``publish.toml``."""
    return tomllib.loads((root / "publish.toml").read_text(encoding="utf-8"))


def version_of(root: Path) -> str:
    """Return the version, which stands in ``desim_uav/__init__.py`` only."""
    text = (root / "desim_uav" / "__init__.py").read_text(encoding="utf-8")
    (version,) = re.findall(r'^__version__ = "(.+)"$', text, re.MULTILINE)
    return str(version)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
