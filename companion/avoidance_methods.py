"""The methods of avoidance. A method is one entry of `METHODS` and the module that its factory is in, or a planner of
another package."""

from typing import NamedTuple

from companion.plugins import Kind, plugin


class Method(NamedTuple):
    """What the settings, the command line and the studies need to know of a method without importing it."""

    name: str
    summary: str
    factory: str
    """"module:class", imported when the method is chosen. The class takes the `config.Avoidance` and is an
    `avoidance.methods.PathPlanner` if the method is mapped, else an `avoidance.methods.GoalRule`."""
    mapped: bool = False
    """It plans paths over the map, in the planner's process, and the guard is on unless it is switched off."""
    needs_scan: bool = True
    """It can't fly without a LiDAR."""
    table: str | None = None
    """Its settings, as a table of [avoidance]; None: it has none, or those of [avoidance] itself."""


_ENTRIES = (
    Method(
        "astar",
        "A* over the map",
        "companion.avoidance.astar_planner:AStarPlanner",
        mapped=True,
        table="plan",
    ),
    Method(
        "rrt",
        "BIT* or Informed RRT* over the map",
        "companion.avoidance.rrt:RrtPlanner",
        mapped=True,
        table="rrt",
    ),
    Method(
        "vfh",
        "VFH+ on the map",
        "companion.avoidance.vfh:VfhPlanner",
        mapped=True,
        table="vfh",
    ),
    Method("paper", "the paper's rule, made to be flown", "companion.avoidance.paper:PaperRule"),
    Method(
        "paper-literal",
        "the paper's rule as printed, for its experiment",
        "companion.avoidance.paper_literal:LiteralPaperRule",
    ),
    Method("none", "straight to the goal", "companion.avoidance.none:NoAvoidance", needs_scan=False),
)

METHODS = {method.name: method for method in _ENTRIES}
"""Those that are built in, by name, in the order in which they are listed to users."""

FALLBACK = "vfh"
"""The mapped method that gives a direction where another mapped one finds no path."""


def method_of(name: str) -> Method:
    """The method of that name, built in or of another package. Raises ValueError if there is none."""
    planner = plugin(Kind.PLANNER, "method", name, METHODS)
    return METHODS[name] if planner is None else Method(name, planner.package, "", mapped=True)


def methods_in_use(chosen: str) -> tuple[str, ...]:
    """The names of all methods that fly when one is chosen."""
    return (chosen,) if not method_of(chosen).mapped or chosen == FALLBACK else (FALLBACK, chosen)


def listed(names: tuple[str, ...] = tuple(METHODS)) -> str:
    """Names for a sentence: "a, b or c"."""
    return " or ".join((", ".join(names[:-1]), names[-1])) if len(names) > 1 else names[0]
