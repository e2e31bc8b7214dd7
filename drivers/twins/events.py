"""What happens to a simulated device, for whoever runs it."""

import json
import sys
from collections.abc import Mapping


class Events:
    """Prints a JSON object per line. It keeps to the standard output of when it was made: a command that later runs in
    this process with another one, as in tests, does not get its lines.
    """

    def __init__(self) -> None:
        self._stream = sys.stdout

    def tell(self, event: Mapping[str, object]) -> None:
        """Print one, at once. Raises BrokenPipeError if nobody reads any longer."""
        print(json.dumps(event), file=self._stream, flush=True)
