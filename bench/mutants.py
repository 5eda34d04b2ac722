"""How many of some seeded mutants of the link, the protocol and the supervision `make quick`'s tests notice.

    python bench/mutants.py [--count 60] [--first 0] [--seed 1] [--files 'protocol/*.py' ...] [--json FILE]

A mutant is the project with one place changed: a comparison, a sign, a number, a condition turned round, a statement
left out. Each is tested in a copy of the project, first by the tests of its own folder, then by all. Files are drawn by
the number of their places. Some mutants do what the original does; they count as survivors, too.
"""

import argparse
import ast
import json
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parent.parent
FILES = (
    "protocol/*.py",
    "companion/link/*.py",
    "companion/supervision/*.py",
    "vehicle_sim/autopilot/flight_control.py",
)
LIMIT_S = 900
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Add: ast.Sub, ast.Sub: ast.Add,
    ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Mutant:
    """One place of a file, of which the bytes from `begin` to `end` are replaced."""

    file: str
    line: int
    begin: int
    end: int
    before: str
    after: str

    def apply(self, source: bytes) -> bytes:
        return source[: self.begin] + self.after.encode() + source[self.end :]


def changed(node: ast.AST) -> ast.AST | str | None:
    """What takes the place of a node; None for nodes that are left alone."""
    match node:
        case ast.Compare(ops=[ast.cmpop() as sign]) if type(sign) in SWAPPED:
            return ast.Compare(node.left, [SWAPPED[type(sign)]()], node.comparators)  # type: ignore[list-item]
        case ast.BinOp(op=sign) if type(sign) in SWAPPED:
            return ast.BinOp(node.left, SWAPPED[type(sign)](), node.right)  # type: ignore[arg-type]
        case ast.BoolOp(op=sign):
            return ast.BoolOp(SWAPPED[type(sign)](), node.values)  # type: ignore[arg-type]
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            return node.operand
        case ast.Constant(value=bool(value)):
            return ast.Constant(not value)
        case ast.Constant(value=int(value) | float(value)):
            return ast.Constant(10 * value or 1)
        case ast.Expr(value=ast.Call()):
            return "pass"
        case _:
            return None


def parts(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes that run: no annotations, and nothing in formatted texts, where nodes have no place of their own."""
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "format_spec"):
            continue
        for each in value if isinstance(value, list) else [value]:
            if isinstance(each, ast.AST) and not isinstance(each, ast.JoinedStr):
                yield each
                yield from parts(each)


def mutants(path: Path) -> Iterator[Mutant]:
    source = path.read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in parts(ast.parse(source)):
        after = changed(node)
        if after is None or not isinstance(node, ast.expr | ast.stmt) or node.end_lineno is None:
            continue
        begin, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + (node.end_col_offset or 0)
        text = after if isinstance(after, str) else f"({ast.unparse(after)})"
        yield Mutant(str(path.relative_to(ROOT)), node.lineno, begin, end, source[begin:end].decode(), text)


def near(file: str) -> str:
    """The tests beside a file: those of its folder."""
    folder = ROOT / "tests" / Path(file).parent
    return str(folder.relative_to(ROOT)) if folder.is_dir() else "tests"


def quick(place: Path, tests: Sequence[str], workers: int) -> str | None:
    """The first failure of `make quick`'s tests, None without one."""
    options = f"-x -n {workers} -p no:cacheprovider".split()
    command = [sys.executable, "-m", "pytest", *options, "-m", "not slow", *tests]
    try:
        run = subprocess.run(command, cwd=place, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return f"no end after {LIMIT_S} s"
    if run.returncode == 0:
        return None
    failed = [line for line in run.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0] if failed else run.stdout[-300:] + run.stderr[-300:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="so many of them are left out: they were judged before")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--files", nargs="+", default=FILES, help="patterns of files that are changed")
    parser.add_argument("--workers", type=int, default=3, help="of pytest")
    parser.add_argument("--json", type=Path, help="a file for all of them")
    arguments = parser.parse_args()
    found = [each for pattern in arguments.files for path in sorted(ROOT.glob(pattern)) for each in mutants(path)]
    drawn = random.Random(arguments.seed).sample(found, min(arguments.count, len(found)))[arguments.first :]
    print(f"{len(drawn)} of {len(found)} mutants", flush=True)
    killers: dict[Mutant, str | None] = {}
    with TemporaryDirectory() as folder:
        place = Path(folder) / "project"
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in listed.split("\0")[:-1]:
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / name)
        if failure := quick(place, ["tests"], arguments.workers):
            raise SystemExit(f"the tests fail without a mutant: {failure}")
        for mutant in drawn:
            file = place / mutant.file
            source = file.read_bytes()
            file.write_bytes(mutant.apply(source))
            tests = near(mutant.file)
            killer = quick(place, [tests], arguments.workers) or quick(place, ["tests"], arguments.workers)
            file.write_bytes(source)
            killers[mutant] = killer
            verdict = killer or "SURVIVES"
            print(f"{mutant.file}:{mutant.line}: {mutant.before} -> {mutant.after}: {verdict}", flush=True)
    killed = sum(killer is not None for killer in killers.values())
    print(f"{killed} of {len(killers)} killed ({100.0 * killed / len(killers):.0f} %)")
    if arguments.json:
        rows = [asdict(mutant) | {"killer": killer} for mutant, killer in killers.items()]
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
