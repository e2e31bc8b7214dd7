"""What the package is made of: a CycloneDX list of every Python distribution in it and of the libraries they carry.

Made from what lies in the package, not from what was asked for. The same tree gives the same list.
"""

import hashlib
import re
from collections.abc import Iterator
from datetime import datetime
from importlib.metadata import Distribution, distributions
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL

_LIBRARY = re.compile(r"\.so(\.\d+)*$")
"""Native libraries that a wheel brings along; its own extension modules belong to it."""


def sbom(site: Path, name: str, version: str, at: datetime) -> str:
    """JSON of CycloneDX 1.6. site: the folder site-packages. name, version: of the package. at: when it was made."""
    found = sorted(distributions(path=[str(site)]), key=lambda one: _canonical(one.name))
    assert found, f"{site} holds no distribution"
    parts = [_distribution(one) for one in found if _canonical(one.name) != name]
    parts += _libraries(site)
    own = next(one for one in found if _canonical(one.name) == name)
    root = _distribution(own, ComponentType.APPLICATION)
    bom = Bom(components=parts, serial_number=uuid5(NAMESPACE_URL, f"{name} {version} {_digest(parts)}"))
    bom.metadata.component, bom.metadata.timestamp = root, at
    bom.register_dependency(root, parts)
    text: str = JsonV1Dot6(bom).output_as_string(indent=1)
    return text + "\n"


def _distribution(one: Distribution, kind: ComponentType = ComponentType.LIBRARY) -> Component:
    name, stated = _canonical(one.name), one.metadata.get("License-Expression") or one.metadata.get("License") or ""
    classified = [
        line.rpartition(" :: ")[2]
        for line in one.metadata.get_all("Classifier") or []
        if line.startswith("License :: ")
    ]
    words = stated if stated and "\n" not in stated and len(stated) < 100 else ", ".join(classified)
    licences = [LicenseFactory().make_from_string(words)] if words else []
    purl = PackageURL("pypi", None, name, one.version)
    return Component(name=name, version=one.version, type=kind, purl=purl, bom_ref=str(purl), licenses=licences)


def _libraries(site: Path) -> Iterator[Component]:
    """Those in folders such as numpy.libs, by their content: a wheel does not say which version it brought."""
    for file in sorted(site.glob("*.libs/*")):
        if _LIBRARY.search(file.name):
            digest = hashlib.sha256(file.read_bytes()).hexdigest()
            place = file.relative_to(site).as_posix()
            hashes = [HashType(alg=HashAlgorithm.SHA_256, content=digest)]
            yield Component(name=place, type=ComponentType.FILE, bom_ref=f"file:{place}", hashes=hashes)


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _digest(parts: list[Component]) -> str:
    told = "\n".join(f"{part.bom_ref} {part.version} {[one.content for one in part.hashes]}" for part in parts)
    return hashlib.sha256(told.encode()).hexdigest()
