"""The cameras that were current, to go back and forth between."""

from dataclasses import dataclass, field

from visaug.diagnosis.session import Setup


@dataclass
class Past:
    """States of the bench in the order in which they came about.

    Attributes:
        entries: what was done and the state after it; the first is the camera file as given.
        at: which of them is current.
    """

    entries: list[tuple[str, Setup]] = field(default_factory=lambda: [("camera as given", Setup())])
    at: int = 0

    def put(self, action: str, setup: Setup, instead: bool = False) -> None:
        """After a change: states that were undone are dropped.

        Args:
            instead: the change goes on with the last one, in whose place it is put.
        """
        first = self.at if instead and self.at else self.at + 1
        self.entries[first:] = [(action, setup)]
        self.at = first

    def go(self, to: int) -> Setup:
        """Back or forward to a state, by its place; one that is not there is the nearest."""
        self.at = min(max(to, 0), len(self.entries) - 1)
        return self.entries[self.at][1]
