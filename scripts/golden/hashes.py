"""golden/HASHES: the sha256 of every golden file, and of the scripts and requirements that made it.

    python3 scripts/golden/hashes.py    says within a second whether data and makers are those that were last compared; needs the standard library only

A group is stamped by the command that makes or compares its files: it then stands for a regeneration that nobody has to repeat while nothing changed.
"""

import hashlib
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "golden" / "HASHES"
QUADROTOR, LOG_FILES, STUDY = "golden/quadrotor/", "golden/log_files/", "golden/study_ci/"
#: Of each group: what stamps it, and its files. The study of the gate is the program's own.
GROUPS = {
    "cases": ("in scripts/: python -m golden --stamp", ("golden/*/*.json", "scripts/golden/*.py", "scripts/withheld/*.py", "scripts/requirements.lock"),
              (QUADROTOR, LOG_FILES, STUDY, "scripts/golden/hashes.py")),
    "quadrotor": ("python scripts/golden_quadrotor.py --stamp", ("golden/quadrotor/*.json", "scripts/golden_quadrotor.py", "scripts/requirements.lock"), ()),
    "log_files": ("in scripts/: python -m log_files --stamp", ("golden/log_files/*", "scripts/log_files/*.py", "scripts/requirements-logs.lock"), ()),
}


def lines(group: str) -> list[str]:
    """The group's part of the file as it would be now."""
    command, patterns, others = GROUPS[group]
    paths = sorted({path for pattern in patterns for path in ROOT.glob(pattern) if path.is_file() and path.suffix != ".md"})
    names = [path.relative_to(ROOT).as_posix() for path in paths]
    kept = [name for name in names if not name.startswith(others)] if others else names
    return [f"# {group}: {command}", *(f"{hashlib.sha256((ROOT / name).read_bytes()).hexdigest()}  {name}" for name in kept)]


def stored() -> dict[str, list[str]]:
    """The parts of the file as they are."""
    parts: dict[str, list[str]] = {}
    group = ""
    for line in FILE.read_text(encoding="utf-8").splitlines() if FILE.exists() else []:
        group = line[2:].partition(":")[0] if line.startswith("# ") else group
        parts.setdefault(group, []).append(line)
    return parts


def stamp(group: str) -> None:
    """Writes the group's part anew."""
    parts = stored() | {group: lines(group)}
    FILE.write_text("\n".join(line for name in GROUPS for line in parts.get(name, [])) + "\n", encoding="utf-8")
    print(f"stamped: {group}")


def main() -> int:
    parts, failed = stored(), False
    for group, (command, _, _) in GROUPS.items():
        differing = sorted({line.split()[-1] for line in set(lines(group)) ^ set(parts.get(group, [])) if not line.startswith("#")})
        if differing:
            failed = True
            some = ", ".join(differing[:5]) + (f" and {len(differing) - 5} more" if len(differing) > 5 else "")
            print(f"golden/HASHES: {group} was last compared with other files ({some}); {command}", file=sys.stderr)
    print("golden/HASHES: " + ("see above" if failed else "data and makers are those that were last compared"))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
