#!/usr/bin/env python3
"""Change one thing in one line, run the tests that should notice, and count those that do.

Needs cosmic-ray (requirements/mutants.in) beside the test requirements. Works on a copy of the
files that git knows or that are new, so the checkout is never touched. What is drawn depends on
the seed and the code alone.

    python scripts/mutants.py [--each 6] [--seed 0] [--jobs 2] [FILE ...]
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
CORE = "iolspi_ros/core"
TESTS = {
    f"{CORE}/buffer.py": "buffer checkpoint",
    f"{CORE}/checkpoint.py": "checkpoint",
    f"{CORE}/dual.py": "refresh",
    f"{CORE}/features.py": "features",
    f"{CORE}/learner.py": "registry online",
    f"{CORE}/lspi.py": "lspi moments refresh",
    f"{CORE}/lspi_settings.py": "config online shield",
    f"{CORE}/moments.py": "moments online",
    f"{CORE}/online.py": "checkpoint online refused shield",
    f"{CORE}/reference.py": "reference",
    f"{CORE}/refresh.py": "refused refresh",
    f"{CORE}/samples.py": "buffer checkpoint online pairing",
    f"{CORE}/shield.py": "shield checkpoint",
    f"{CORE}/solve.py": "lspi refresh moments",
    "iolspi_ros/cdr.py": "wire",
    "iolspi_ros/pairing.py": "pairing bags",
    "iolspi_ros/wire.py": "wire pairing",
    "msg_bridge/mavlink/arbiter.py": "arbiter flight",
    "msg_bridge/mavlink/envelope.py": "envelope flight",
}
"""Which of test/test_*.py should notice a change of a file."""
PATIENCE = 300.0
"""Seconds after which a mutant that loops is taken for noticed; whole test runs need less."""
DULL = ("BitOr", "RemoveDecorator", "ExceptionReplacer", "VariableInserter", "VariableReplacer")
"""Operators that change types, or what numba compiles, rather than what the code does."""


class Mutant(NamedTuple):
    """One change of one file."""

    file: str
    operator: str
    code: str
    line: int
    before: str
    after: str


def mutants(file: str) -> list[Mutant]:
    """Every change of a file; of the operators that could stand at one place, each once."""
    from cosmic_ray import mutating, plugins

    whole = (ROOT / file).read_text(encoding="utf-8")
    found = []
    for name in sorted(plugins.operator_names()):
        if any(word in name for word in DULL):
            continue
        operator, occurrence = plugins.get_operator(name)(), 0
        while (code := mutating.mutate_code(whole, operator, occurrence)) is not None:
            occurrence += 1
            line, before, after = difference(whole, code)
            if not prose(before):
                found.append(Mutant(file, name.removeprefix("core/"), code, line, before, after))
    return found


def prose(line: str) -> bool:
    """Whether a line cannot change what happens: a decorator, an import, a signature's types."""
    return line.startswith(("@", "from ", "import ", "def ", "class "))


def difference(before: str, after: str) -> tuple[int, str, str]:
    """Number of the first line that differs, and what it says on both sides."""
    sides = zip(before.splitlines(), after.splitlines(), strict=False)
    for number, (old, new) in enumerate(sides, 1):
        if old != new:
            return number, old.strip(), new.strip()
    return 0, "", ""


def draw(file: str, each: int, rng: random.Random) -> list[Mutant]:
    """Some of the changes of a file, in different lines as long as there are any."""
    lines: dict[int, list[Mutant]] = {}
    for mutant in mutants(file):
        lines.setdefault(mutant.line, []).append(mutant)
    chosen = rng.sample(sorted(lines), min(each, len(lines)))
    return [rng.choice(lines[line]) for line in sorted(chosen)]


class Copy:
    """A copy of the checkout in which one mutant after the other is tried."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "checkout"
        self.cache = folder / "numba"
        listed = subprocess.run(
            ["git", "ls-files", "-co", "--exclude-standard"],
            cwd=ROOT, check=True, capture_output=True, text=True,
        ).stdout.splitlines()  # fmt: skip
        for name in listed:
            if (ROOT / name).is_file():
                (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, self.folder / name)

    def passes(self, file: str, code: str) -> bool:
        """Whether all tests of a file pass with other code in it."""
        path = self.folder / file
        whole = path.read_text(encoding="utf-8")
        tests = [f"test/test_{name}.py" for name in TESTS[file].split()]
        there = [test for test in tests if (self.folder / test).is_file()]
        if "njit" in whole:  # what calls it was compiled with the code before
            shutil.rmtree(self.cache, ignore_errors=True)
        path.write_text(code, encoding="utf-8")
        try:
            return run(self.folder, there, self.cache)
        finally:
            path.write_text(whole, encoding="utf-8")


def run(folder: Path, tests: list[str], cache: Path) -> bool:
    """Whether tests pass, within `PATIENCE`."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m",
               "not slow", *tests]  # fmt: skip
    own = {"NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    process = subprocess.Popen(
        command, cwd=folder, env=os.environ | own, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        return process.wait(PATIENCE) == 0
    except subprocess.TimeoutExpired:
        return False
    finally:
        if process.poll() is None:
            os.killpg(process.pid, 9)
            process.wait()


def main() -> int:
    """Draw, try and count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--each", type=int, default=6, help="mutants of each file (6)")
    parser.add_argument("--seed", type=int, default=0, help="of what is drawn (0)")
    parser.add_argument("--jobs", type=int, default=2, help="at a time (2)")
    given = parser.parse_args()
    files = given.files or [file for file in TESTS if (ROOT / file).is_file()]
    drawn = []
    for file in files:
        found = draw(file, given.each, random.Random(f"{given.seed} {file}"))
        drawn += found
    start, survived = time.monotonic(), []
    with tempfile.TemporaryDirectory(prefix="iolspi-mutants-") as temporary:
        copies = [Copy(Path(temporary) / str(job)) for job in range(given.jobs)]

        def work(job: int) -> None:
            for number in range(job, len(drawn), given.jobs):
                mutant = drawn[number]
                lives = copies[job].passes(mutant.file, mutant.code)
                if lives:
                    survived.append(number)
                print(
                    f"{number + 1}/{len(drawn)} {'SURVIVED' if lives else 'killed'} "
                    f"{mutant.file}:{mutant.line} {mutant.operator}",
                    flush=True,
                )

        for file in dict.fromkeys(mutant.file for mutant in drawn):
            whole = (ROOT / file).read_text(encoding="utf-8")
            if not copies[0].passes(file, whole):
                print(f"{file}: its tests fail without any change", file=sys.stderr)
                return 2
        with ThreadPoolExecutor(given.jobs) as pool:
            list(pool.map(work, range(given.jobs)))
    minutes = (time.monotonic() - start) / 60
    print(
        f"\n{len(drawn)} mutants (seed {given.seed}, {given.each} a file), "
        f"{len(drawn) - len(survived)} killed, {len(survived)} survived, {minutes:.1f} min"
    )
    for number in sorted(survived):
        mutant = drawn[number]
        print(f"{mutant.file}:{mutant.line} {mutant.operator}")
        for mark, text in zip("-+", (mutant.before, mutant.after), strict=True):
            print(f"    {mark} {text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
