"""A program killed while it saves leaves the old result or the new one, never a part."""

import os
import subprocess
import sys

import pytest

SCRIPT = '''
import os, random, signal, sys, time
from dataclasses import replace
from pathlib import Path
from floquid.pipeline import identify
from floquid.store import load, save
from floquid.findings import Finding
from floquid.systems import JeffcottRotor

path = Path(sys.argv[1]) / "result.h5"
record = JeffcottRotor().simulate(n_periods=256, samples_per_period=16, noise=0.01)
found = identify(record)
words = ("first " * 50, "second " * 5000)
results = [replace(found, findings=(Finding("sentence", "warning", words=text),)) for text in words]
save(results[0], path)

def slowly(self, content):
    """A slow disk, so that most kills fall into the writing of the file."""
    with self.open("wb", buffering=0) as stream:
        for start in range(0, len(content), 8192):
            stream.write(content[start : start + 8192])
            time.sleep(0.002)

rest = random.Random(0)
for _ in range(10):
    ready, signal_ready = os.pipe()
    child = os.fork()
    if child == 0:
        Path.write_bytes = slowly
        os.write(signal_ready, b".")
        while True:
            for result in results:
                save(result, path)
    os.read(ready, 1)
    time.sleep(rest.uniform(0.0, 0.3))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    back = load(path)
    assert back.warnings[0] in words, back.warnings
    assert (back.records[0].values == record.values).all()
left = [name for name in os.listdir(path.parent) if name != path.name]
print(len(left))
'''


@pytest.mark.kill
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_kill_9_at_ten_moments(tmp_path):
    run = subprocess.run([sys.executable, "-c", SCRIPT, str(tmp_path)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    # A killed program cannot tidy up. What it left shows that it was killed in the middle of a file.
    assert int(run.stdout) > 0
