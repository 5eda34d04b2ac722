"""References with derivatives up to snap: jerk-limited motion to a target that may move, and tracks along curves."""

from companion.trajectory.generator import ReferenceGenerator
from companion.trajectory.track import Track, track_of

__all__ = ["ReferenceGenerator", "Track", "track_of"]
