"""Describes how one picture differs from that of rigid tissue at rest."""

from dataclasses import dataclass

from probewatch.drivers.twins.scene.tissue import Displacement, Floats


@dataclass(frozen=True, slots=True)
class Sight:
    """Holds the differences. moved: how far tissue has moved where the picture sees it. gain: (h, w) factor on the
    amplitude of its echoes, less in a shadow. added: (h, w) amplitude of what is not tissue.
    """

    moved: Displacement | None = None
    gain: Floats | None = None
    added: Floats | None = None
