"""The fuzzer itself, a process of its own: it may crash, hang or run out of memory, and its parent goes on.

Run by `python -m tests.fuzz`. The library is instrumented, so that inputs which reach new code are kept and changed
further; the C libraries behind it run as they are.
"""

from __future__ import annotations

import json
import resource
import sys
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from random import Random
from zlib import crc32

import atheris

_INSTRUMENTED = ("floquid.readers", "floquid.store", "floquid.floquet", "floquid.cli.arguments.options", "floquid.core")


def _others() -> list[str]:
    """The modules of the library that are left as they are."""
    root = Path(find_spec("floquid").origin).parent  # type: ignore[union-attr, arg-type]
    names = [".".join(("floquid", *path.relative_to(root).with_suffix("").parts)) for path in root.rglob("*.py")]
    names = [name.removesuffix(".__init__") for name in names]
    return [name for name in names if not name.startswith(_INSTRUMENTED)]


with atheris.instrument_imports(include=["floquid"], exclude=_others(), enable_loader_override=False):
    from tests.fuzz.promise import SECONDS, Watch, broken
    from tests.fuzz.targets import TARGETS

    import floquid.cli
    import floquid.floquet
    import floquid.readers
    import floquid.store  # noqa: F401

_ADDRESSES = 3 << 30
_LONGEST = 1 << 18


def main() -> None:
    """Fuzz one target: the name, the folder of findings, the folder to work in, then what libFuzzer is told."""
    target, kept, folder = TARGETS[sys.argv[1]], Path(sys.argv[2]), Path(sys.argv[3])
    watch = Watch()
    seen: set[str] = {path.stem for path in kept.glob("*.json")}

    def one(data: bytes) -> None:
        if not data:
            return
        path = folder / f"input{target.suffix(data)}"
        path.write_bytes(data)
        first, *others = target.calls
        calls = (first, others[crc32(data) % len(others)]) if others else (first,)
        for finding in broken(calls, path, watch):
            name = f"{target.name}-{sha256(finding.key.encode()).hexdigest()[:12]}"
            if name not in seen:
                seen.add(name)
                (kept / f"{name}.input").write_bytes(data)
                words = {"target": target.name, "key": finding.key, "words": finding.words}
                (kept / f"{name}.json").write_text(json.dumps(words, indent=1), encoding="utf-8")

    def mutated(data: bytes, longest: int, seed: int) -> bytes:
        try:
            found = target.mutate(data, Random(seed), lambda part: atheris.Mutate(part, max(len(part) + 64, 64)))
        except Exception:  # noqa: BLE001  # what cannot be built is no input, and no finding
            found = b""
        return found if 0 < len(found) <= longest else atheris.Mutate(data, longest)

    for data in target.seeds():  # what loads late loads now, and is no deed of an input
        path = folder / f"input{target.suffix(data)}"
        path.write_bytes(data)
        broken(target.calls, path)
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
    options = [f"-timeout={int(SECONDS)}", f"-max_len={_LONGEST}", "-rss_limit_mb=0", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], *options, *sys.argv[4:]], one, custom_mutator=mutated)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
