"""Run by `.ci/platform` where floquid is installed without extras: what must work does, and what needs more says so."""

import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

EXTRAS = ("asammdf", "comtrade", "control", "distributed", "pandas", "pyarrow", "python_calamine", "nptdms", "xarray")

began = time.perf_counter()
import floquid as fq  # noqa: E402

took = time.perf_counter() - began
assert Path(fq.__file__).is_relative_to(sys.prefix), fq.__file__
assert not [name for name in EXTRAS if find_spec(name)], "extras are installed"

record = fq.systems.JeffcottRotor().simulate(n_periods=256, noise=0.01)
for suffix in ("npz", "csv", "mat", "h5", "uff"):
    fq.write(record, f"run.{suffix}")
    assert fq.identify(fq.read(f"run.{suffix}", period=record.clock.period), validate=False).model.order == 4, suffix
for suffix, extra in (("tdms", "tdms"), ("parquet", "parquet"), ("xlsx", "excel")):
    Path(f"run.{suffix}").write_bytes(b"TDSm, PAR1 or PK, it is not looked at")
    for ask in (fq.read, lambda name: fq.write(record, name))[: 2 if suffix == "parquet" else 1]:
        try:
            ask(f"run.{suffix}")
        except fq.InputError as error:
            assert f'pip install "floquid[{extra}]"' in str(error), error
        else:
            raise AssertionError(f"{suffix} without its package")

try:
    fq.fleet("run.npz")
except fq.InputError as error:
    assert 'pip install "floquid[fleet]"' in str(error), error
else:
    raise AssertionError("a fleet without pyarrow")

script = Path(sys.executable).with_name("floquid")
done = subprocess.run([script, "identify", "run.npz", "--out", "place"], capture_output=True, text=True, check=False)
assert done.returncode == 0, done.stderr
names = {path.name for path in Path("place").iterdir()}
assert names == {"result.h5", "summary.json", "settings.toml", "report.html"}, names
print(f"import floquid: {took:.2f} s")
